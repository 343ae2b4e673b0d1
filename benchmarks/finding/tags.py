"""Tags and ChArUco boards: found, false tags, and error.

The dictionary of single tags is not given. A tag is found if its number is read; other numbers are
false. The random cells are 4 x 4. The layout of the ChArUco boards is given; that of the cube is
`charuco:10x10:0.75:6X6_1000`, and its focal length by Zhang's method 5145 +- 13 px.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from harness.rows import Row
from numpy.typing import NDArray

import trisquare as ts
from trisquare import simulate
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.sampling import straight_sides
from trisquare.detection.tags.codes import opencv_dictionary
from trisquare.detection.tags.decode import decode_tags
from trisquare.detection.tags.families import DICTIONARIES, TagSearch
from trisquare.measurement.find import search
from trisquare.measurement.sheets import Sheet
from trisquare.measurement.squares import Square
from trisquare.simulate.scene import rectangle
from trisquare_scenes.tagged import charuco_box_scene, tag_scene

PICTURES = 56
SEED = 40
NAMES = (
    "4X4_50",
    "4X4_1000",
    "5X5_250",
    "6X6_250",
    "7X7_1000",
    "APRILTAG_16H5",
    "APRILTAG_36H11",
    "ARUCO_ORIGINAL",
)
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels
CONTRAST = 175.0
JPEG_QUALITY = 85
FOUND_TARGET = 0.98

FAR_PICTURES = 40
FAR_SEED = 43
FAR_SIDES = (20.0, 60.0)
"""Range of the sides in pixels, before foreshortening."""
FAR_TARGET = 0.9
MIN_FAR_SIDE = 20.0
"""Minimum length, in pixels, of a tag's shortest side: a cell of smaller ones is two or three."""

BOUND_TARGET = 1.3

BOXES = 8
BOX_SEED = 41

CHANCE_PICTURES = 300
QUADS_PER_PICTURE = 5
CHANCE_SEED = 42
FALSE_TARGET = 0.01

CUBE = Path(__file__).resolve().parents[3] / "shared" / "data" / "charuco-cube" / "cam0"
CUBE_LAYOUT = "charuco:10x10:0.75:6X6_1000"
CUBE_FOCAL = 5145.0  # +- 13, by Zhang's method from all pictures
CUBE_TARGET = 20
POOLED_TARGET = 0.005


def measure() -> list[Row]:
    """Draw tags, boxes and clutter, and measure the photographs of the cube."""
    rows = [*_single_tags(), _far_tags(), _chance(), _boxes()]
    return rows + (_cube() if CUBE.is_dir() else [])


def _single_tags() -> list[Row]:
    """Search three tags of 60 to 250 px, tilted by 25 to 60 degrees, without a named dictionary."""
    whole = found = false = by_opencv = 0
    ratios = []
    for index in range(PICTURES):
        rng = np.random.default_rng([SEED, index])
        name = NAMES[index % len(NAMES)]
        scene, numbers = tag_scene(rng, name)
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture = simulate.render(scene, rng, noise=noise, blur=blur, contrast=CONTRAST)
        coded = _coded(picture)
        seen = _numbers_in(coded)
        whole += sorted(seen) == sorted(numbers)
        found += len(set(seen) & set(numbers))
        false += sum(number not in numbers for number in seen)
        detector = cv2.aruco.ArucoDetector(opencv_dictionary(name))
        _, read, _ = detector.detectMarkers(coded)
        by_opencv += len(set(numbers) & set(np.ravel([] if read is None else read).tolist()))
        try:
            result = ts.calibrate(picture, tone="linear")
        except ts.TrisquareError:
            continue
        sigma = simulate.pixel_sigma(noise, CONTRAST, blur)
        bound = simulate.cramer_rao_bound(scene, sigma)["fx"]
        ratios.append((result.camera.fx - scene.camera.fx) / bound)
    ratio = float(np.sqrt(np.mean(np.square(ratios))))
    every = 3 * PICTURES
    print(f"  OpenCV's detector, dictionary given: {by_opencv} of {every} tags; ours {found}")
    print(f"  {len(ratios)} of {PICTURES} pictures calibrate alone (the others are refused)")
    return [
        Row(
            f"{PICTURES} pictures of three tags, JPEG {JPEG_QUALITY}: found",
            f"{whole} with all tags, {found} of {every} tags, {false} false",
            f">= {FOUND_TARGET:.0%} of pictures, none false",
            whole >= FOUND_TARGET * PICTURES and false == 0,
        ),
        Row(
            f"{PICTURES} pictures of three tags, no JPEG: error / Cramer-Rao bound of fx",
            f"{ratio:.2f}",
            f"<= {BOUND_TARGET:.2f}",
            ratio <= BOUND_TARGET,
        ),
    ]


def _coded(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Encode a picture as JPEG and decode it."""
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def _numbers_in(picture: NDArray[np.uint8]) -> list[int]:
    """Return the numbers of the single tags that are found."""
    targets = search(picture, TargetKinds.parse("auto")).found
    tags = [one.outline.tag for one in targets if isinstance(one, Square)]
    return [tag.number for tag in tags if tag is not None]


def _far_tags() -> Row:
    """Search three tags of 20 to 60 px, tilted by 25 to 60 degrees, without a named dictionary."""
    found = large = false = 0
    for index in range(FAR_PICTURES):
        rng = np.random.default_rng([FAR_SEED, index])
        scene, numbers = tag_scene(rng, NAMES[index % len(NAMES)], sides=FAR_SIDES)
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture = simulate.render(scene, rng, noise=noise, blur=blur, contrast=CONTRAST)
        seen = _numbers_in(_coded(picture))
        false += sum(number not in numbers for number in seen)
        for target, number in enumerate(numbers):
            corners = scene.image_points(target, rectangle(0.5, 0.5))
            sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
            if sides.min() >= MIN_FAR_SIDE:
                large += 1
                found += number in seen
    return Row(
        f"{FAR_PICTURES} pictures of three tags of {FAR_SIDES[0]:.0f}-{FAR_SIDES[1]:.0f} px, JPEG "
        f"{JPEG_QUALITY}: found, of those with sides of {MIN_FAR_SIDE:.0f} px and more",
        f"{found} of {large}, {false} false",
        f">= {FAR_TARGET:.0%}, none false",
        found >= FAR_TARGET * large and false == 0,
    )


def _chance() -> Row:
    """Count dark squares with random cells of 4 x 4, the shortest code, that are taken for tags."""
    false = 0
    for index in range(CHANCE_PICTURES):
        rng = np.random.default_rng([CHANCE_SEED, index])
        grey = np.full((90, 90 * QUADS_PER_PICTURE), 220, np.uint8)
        for quad in range(QUADS_PER_PICTURE):
            cells = np.zeros((6, 6), np.uint8)
            cells[1:-1, 1:-1] = rng.integers(0, 2, (4, 4))
            x = 90 * quad + 15
            grey[15:75, x : x + 60] = 20 + 200 * np.kron(cells, np.ones((10, 10), np.uint8))
        square = np.array([[14.5, 14.5], [74.5, 14.5], [74.5, 74.5], [14.5, 74.5]])
        corners = square + np.array([[[90 * quad, 0]] for quad in range(QUADS_PER_PICTURE)])
        steps = np.full(QUADS_PER_PICTURE, 200.0)
        blurred = np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.8), dtype=np.uint8)
        found = decode_tags(blurred, straight_sides(corners), steps, TagSearch(DICTIONARIES))
        false += any(tag is not None for tag in found)
    share = false / CHANCE_PICTURES
    return Row(
        f"{CHANCE_PICTURES} pictures of {QUADS_PER_PICTURE} squares of random cells: pictures with "
        "a false tag",
        f"{false} of {CHANCE_PICTURES}",
        f"<= {FALSE_TARGET:.0%}",
        share <= FALSE_TARGET,
    )


def _boxes() -> Row:
    """Use ChArUco boards of known layout: markers and grid lines on one plane, or lines alone."""
    errors: dict[str, list[float]] = {"grid lines": [], "with markers": []}
    for index in range(BOXES):
        rng = np.random.default_rng([BOX_SEED, index])
        scene = charuco_box_scene(rng, squares=5, name="4X4_1000")
        noise, blur = rng.uniform(*NOISE_RANGE), rng.uniform(*BLUR_RANGE)
        picture = simulate.render(scene, rng, noise=noise, blur=blur, contrast=CONTRAST)
        edges = ts.detect(picture, targets="charuco:5x5:0.75:4X4_1000", tone="linear")
        lattices = [figure for figure in edges if figure.polarity is None]
        size = scene.camera.image_size
        for name, figures in (("grid lines", lattices), ("with markers", edges)):
            result = ts.calibrate_edges(figures, size)
            errors[name].append((result.camera.fx - scene.camera.fx) / scene.camera.fx)
    alone, both = (100 * np.sqrt(np.mean(np.square(of))) for of in errors.values())
    return Row(
        f"{BOXES} boxes with three ChArUco boards: rms error of fx",
        f"{both:.3f} % with markers, {alone:.3f} % without",
        "not larger with markers",
        bool(both <= alone),
    )


def _cube() -> list[Row]:
    """Use 24 photographs of a paper cube."""
    targets = TargetKinds.parse(CUBE_LAYOUT)
    photographs = [str(CUBE / f"{number}.jpg") for number in range(24)]
    faces: Counter[int] = Counter()
    for photograph in photographs:
        picture = cv2.imread(photograph, cv2.IMREAD_GRAYSCALE)
        found = search(np.asarray(picture), targets).found
        faces[sum(isinstance(sheet, Sheet) for sheet in found)] += 1
    print(f"  cube: pictures by the number of faces found: {dict(sorted(faces.items()))}")
    with_planes = len(photographs) - faces[0]
    rows = [
        Row(
            f"{len(photographs)} photographs of the cube: with a plane found",
            f"{with_planes} of 24",
            f">= {CUBE_TARGET}",
            with_planes >= CUBE_TARGET,
        )
    ]
    for number in (7, 8):
        result = ts.calibrate(photographs[number], targets=CUBE_LAYOUT)
        fx, std = result.camera.fx, result.std["fx"]
        off = abs(fx - CUBE_FOCAL) / std
        shown = f"fx {fx:.0f} +- {std:.0f}"
        name = f"photograph {number} of the cube: focal length, px"
        rows.append(Row(name, shown, f"{CUBE_FOCAL:.0f} within 3 std", off <= 3.0))
    pooled = ts.calibrate(photographs, targets=CUBE_LAYOUT)
    off = abs(pooled.camera.fx / CUBE_FOCAL - 1.0)
    shown = f"fx {pooled.camera.fx:.0f} +- {pooled.std['fx']:.0f} ({100 * off:.2f} % off)"
    name = f"{len(photographs)} photographs of the cube: focal length, px"
    required = f"{CUBE_FOCAL:.0f} within {100 * POOLED_TARGET:g} %"
    rows.append(Row(name, shown, required, off <= POOLED_TARGET))
    return rows
