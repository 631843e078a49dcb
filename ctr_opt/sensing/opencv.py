"""OpenCV, an optional dependency, imported where it is used."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import MissingExtraError


def opencv() -> Any:
    """The module ``cv2``, or an error that names the extra to install."""
    try:
        return importlib.import_module("cv2")
    except ImportError as error:
        raise MissingExtraError(
            f"cameras need OpenCV, which cannot be imported ({error}): pip install 'ctr_opt[sensing]'"
        ) from None
