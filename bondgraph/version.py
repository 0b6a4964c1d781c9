"""The version, apart from the front door, so that every room may name it."""

__version__ = "0.2.0.dev0"
