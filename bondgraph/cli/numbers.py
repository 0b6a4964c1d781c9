"""Numbers of a command line, checked while it is read."""

from __future__ import annotations

import argparse
import math


def seed(text: str) -> int:
    """A whole number that seeds random draws: at least 0 and below 2**64.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is another.
    """
    value = int(text)
    if not 0 <= value < 2**64:
        raise argparse.ArgumentTypeError(f"{text} must be a whole number of at least 0 and below 2**64")
    return value


def finite(text: str) -> float:
    """A finite number.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is another.
    """
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} must be a finite number")
    return value


def count(text: str) -> int:
    """A whole number of at least 1.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is another.
    """
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} must be at least 1")
    return value


def positive(text: str) -> float:
    """A finite number above zero.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is another.
    """
    value = float(text)
    if not value > 0.0 or not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} must be a positive number")
    return value


def share(text: str) -> float:
    """A number between 0 and 1.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is another.
    """
    value = float(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"{text} must lie between 0 and 1")
    return value
