"""Saving of figures to files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from .text import check_output, write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = (".png", ".pdf", ".svg")
_DPI = 150


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Save a figure, the whole file or nothing; the suffix selects the format.

    Parameters
    ----------
    figure
        The figure.
    path
        Ends in ``.png`` (150 dpi), ``.pdf`` or ``.svg``, in a folder that exists. An existing file is replaced.

    Raises
    ------
    DefinitionError
        The suffix is not allowed, or the folder does not exist.
    """
    target = Path(path)
    check_output(target, FIGURES)
    write_atomically(target, lambda part: figure.savefig(part, format=target.suffix[1:], dpi=_DPI))
