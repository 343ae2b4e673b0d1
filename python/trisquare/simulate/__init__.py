"""Seeded cameras, scenes and edge points with known truth, and the best possible accuracy.

The scenes follow one distribution, which is stated on the documentation's page "How exact it is",
so that every figure quoted for the package can be reproduced from a seed.
"""

from trisquare._support.rotations import tilted
from trisquare.simulate.cramer_rao import cramer_rao_bound, pixel_sigma
from trisquare.simulate.fisheye import TrueFisheye, fisheye, image_circle, wide_scene
from trisquare.simulate.folded_corner import corner_scene
from trisquare.simulate.motion_blur import Motion
from trisquare.simulate.render import render, render_into
from trisquare.simulate.scene import Scene, Target, TrueCamera
from trisquare.simulate.scenes import (
    chessboard_scene,
    edge_points,
    photo_like,
    photo_of_sheets,
    random_camera,
    random_scene,
)

__all__ = [
    "Motion",
    "Scene",
    "Target",
    "TrueCamera",
    "TrueFisheye",
    "chessboard_scene",
    "corner_scene",
    "cramer_rao_bound",
    "edge_points",
    "fisheye",
    "image_circle",
    "photo_like",
    "photo_of_sheets",
    "pixel_sigma",
    "random_camera",
    "random_scene",
    "render",
    "render_into",
    "tilted",
    "wide_scene",
]
