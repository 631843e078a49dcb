"""The version of the package, for all that depends on it."""

__version__ = "0.1.0"
