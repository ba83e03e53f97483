"""Pictures: camera, colours, shapes of modules, and pictures without a browser."""

from typing import Final

SOCIAL_PICTURE_PX: Final = (1200, 630)
"""Width and height of a fold's preview picture for social networks, in pixels: the size that is
recommended for Open Graph images."""
