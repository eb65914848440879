"""Packings, scenes, label images and statistics into files and out of them."""

from typing import TYPE_CHECKING

from voxgran._base import missing_names

if not TYPE_CHECKING:
    __getattr__ = missing_names(__name__)
