"""The renderer is exact to far below the noise: distances, profiles, corners, whole pictures."""

import cv2
import numpy as np
import pytest
from quick import first_quick
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from trisquare import simulate
from trisquare.simulate import random_scene, render, tilted
from trisquare.simulate.edge_profile import (
    bivariate_normal_cdf,
    blurred_step,
    blurred_wedge,
    normal_cdf,
)
from trisquare.simulate.pixel_coverage import EdgeCurve, quadrilateral_coverage
from trisquare.simulate.render import decode_tone, encode_tone
from trisquare.simulate.scene import Scene, Side, Target, TrueCamera, sides_of

BENT = TrueCamera(900.0, 903.0, 650.0, 470.0, np.array([-0.3, 0.1, 1e-3, -8e-4, 0.0]))


def bent_target(kind="square"):
    """A square far off the axis, where barrel distortion bends its sides by several pixels."""
    return Target(tilted(35.0, 20.0, 33.0), np.array([-1.1, -0.75, 2.6]), kind)


def test_normal_cdf_matches_scipy():
    x = np.linspace(-12.0, 12.0, 40001)
    np.testing.assert_allclose(normal_cdf(x), norm.cdf(x), rtol=0, atol=1e-15)


@pytest.mark.parametrize("rho", [-0.95, -0.7, -0.2, 0.0, 0.5, 0.9])
def test_bivariate_cdf_matches_scipy(rho):
    points = np.random.default_rng(1).normal(0.0, 1.5, (40, 2))
    wanted = multivariate_normal(cov=[[1.0, rho], [rho, 1.0]]).cdf(points)
    ours = bivariate_normal_cdf(points[:, 0], points[:, 1], np.full(40, rho))
    np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-7)


@pytest.mark.parametrize("degrees", [0.0, 0.3, 1.0, 17.0, 45.0, 91.0, 178.9])
@pytest.mark.parametrize("blur", [0.3, 0.8, 2.0])
def test_step_matches_numeric_convolution(degrees, blur):
    normal = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
    distances = np.linspace(-3.0, 3.0, 7)
    ours = blurred_step(distances, np.tile(normal, (7, 1)), blur)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    box = 0.5 * (nodes[:, None] * normal[0] + nodes[None, :] * normal[1])
    profile = norm.cdf((distances[:, None, None] + box) / blur)
    wanted = 0.25 * np.einsum("i,j,nij->n", weights, weights, profile)
    np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-9)


@pytest.mark.parametrize("normals", [(10.0, 100.0), (10.0, 60.0), (45.0, 185.0)])
@pytest.mark.parametrize("blur", first_quick([0.3, 0.8]))
def test_wedge_matches_direct_integration(normals, blur):
    """Integrate the blurred wedge row by row: each row of it is a pair of steps."""
    n1, n2 = (np.array([np.cos(a), np.sin(a)]) for a in np.deg2rad(normals))
    points = np.random.default_rng(2).uniform(-1.5, 1.5, (6, 2))
    rows = [np.tile(n, (6, 1)) for n in (n1, n2)]
    ours = blurred_wedge(points @ n1, points @ n2, *rows, blur)

    def along_row(y, x0):
        """Mass, over x, of the pixel-and-blur kernel where both sides are positive at row y."""
        low, high = -np.inf, np.inf
        for n in (n1, n2):
            crossing = -n[1] * y / n[0]
            low, high = (max(low, crossing), high) if n[0] > 0 else (low, min(high, crossing))
        return box_cdf(high - x0) - box_cdf(low - x0) if high > low else 0.0

    def box_cdf(x):
        if np.isinf(x):
            return float(x > 0)
        antiderivative = [
            z * norm.cdf(z) + norm.pdf(z) for z in ((x + 0.5) / blur, (x - 0.5) / blur)
        ]
        return blur * (antiderivative[0] - antiderivative[1])

    def kernel(y):
        return norm.cdf((y + 0.5) / blur) - norm.cdf((y - 0.5) / blur)

    for (x0, y0), grey in zip(points, ours, strict=True):
        wanted, _ = quad(
            lambda y, x0=x0, y0=y0: kernel(y - y0) * along_row(y, x0),
            -8,
            8,
            points=[0.0],
            limit=400,
        )
        assert grey == pytest.approx(wanted, abs=2e-6)


def test_distance_to_bent_side_matches_dense_polyline():
    target = bent_target()
    start, end = target.outlines()[0][:2]
    curve = EdgeCurve(BENT, target, Side(start, end), 20.0)
    along = np.linspace(-0.1, 1.1, 240_001)
    dense = BENT.project(target.to_camera(start + along[:, None] * (end - start)))
    chord = dense[200_000] - dense[40_000 - 20_000]
    bulge = (dense - dense[20_000]) @ np.array([-chord[1], chord[0]]) / np.hypot(*chord)
    assert np.ptp(bulge) > 2.0, "the side is not bent enough to test anything"

    rng = np.random.default_rng(3)
    feet = rng.integers(30_000, 210_000, 200)
    tangent = dense[feet + 1] - dense[feet - 1]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.hypot(*tangent.T)[:, None]
    offset = rng.uniform(-4.0, 4.0, 200)
    pixels = dense[feet] + offset[:, None] * normal
    distance, direction = curve.signed_distance(pixels)
    nearest = np.array([np.hypot(*(dense - pixel).T).min() for pixel in pixels[:20]])
    np.testing.assert_allclose(np.abs(distance[:20]), nearest, rtol=0, atol=1e-6)
    np.testing.assert_allclose(distance, offset, rtol=0, atol=1e-6)
    np.testing.assert_allclose(direction, normal, rtol=0, atol=1e-5)


def supersampled_coverage(camera, target, rows, columns, blur, fine):
    """Apply blur and pixel box to a binary picture on a fine grid, directly from the definition."""
    pad = int(np.ceil(6 * blur)) + 1
    x0, x1, y0, y1 = columns.start - pad, columns.stop + pad, rows.start - pad, rows.stop + pad
    x = x0 - 0.5 + (np.arange((x1 - x0) * fine) + 0.5) / fine
    y = y0 - 0.5 + (np.arange((y1 - y0) * fine) + 0.5) / fine
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = np.column_stack([camera.undistort(pixels), np.ones(len(pixels))])
    plane = rays @ np.linalg.inv(np.column_stack([target.rotation[:, :2], target.translation])).T
    inside = np.all(np.abs(plane[:, :2] / plane[:, 2:]) < 0.5, axis=1)
    image = inside.reshape(len(y), len(x)).astype(np.float64)
    half = int(np.ceil(6 * blur * fine))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / (blur * fine)) ** 2)
    boxed = np.convolve(kernel / kernel.sum(), np.full(fine, 1.0 / fine))

    def weights(count):
        """The weight of each sample of the fine grid in each pixel, along one axis."""
        grid = np.zeros((count, (count + 2 * pad) * fine))
        for pixel in range(count):
            start = (pixel + pad) * fine - half
            grid[pixel, start : start + len(boxed)] = boxed
        return grid

    return weights(y1 - y0 - 2 * pad) @ image @ weights(x1 - x0 - 2 * pad).T


@pytest.mark.parametrize(
    ("corner", "blur"),
    first_quick([(0, 0.5), (2, 1.1), (1, 0.5), (2, 0.5), (3, 0.5), (0, 1.1), (1, 1.1), (3, 1.1)]),
)
def test_corner_of_bent_square_matches_supersampling(corner, blur):
    target = bent_target()
    at = BENT.project(target.to_camera(target.outlines()[0][corner]))
    columns, rows = (slice(int(c) - 6, int(c) + 7) for c in at)
    patch = quadrilateral_coverage(BENT, target, target.sides(), blur)
    whole = np.zeros((960, 1280))
    whole[patch.rows, patch.columns] = patch.coverage
    brute = supersampled_coverage(BENT, target, rows, columns, blur, 48)
    assert brute.max() - brute.min() > 0.2, "the window misses the corner"
    np.testing.assert_allclose(whole[rows, columns], brute, rtol=0, atol=1e-3)
    # The grid's own error is random, so that the mean is far more exact than its worst pixel.
    assert abs((whole[rows, columns] - brute).mean()) < 5e-5


@pytest.mark.parametrize("side", first_quick([3.0, 7.0]))
def test_small_leaning_cell_matches_supersampling(side):
    """In a cell a few blurs wide, every pixel is near all four of its corners."""
    rotation = tilted(55.0, 45.0, 5.0)
    target = Target(rotation, np.array([-0.4, -0.3, 1.0]) * BENT.fx / side)
    sides = target.sides()
    first, second = (
        ends[1] - ends[0]
        for ends in (BENT.project(target.to_camera(np.array([s.start, s.end]))) for s in sides[:2])
    )
    cosine = first @ second / (np.hypot(*first) * np.hypot(*second))
    assert abs(cosine) > 0.3, "the cell does not lean"
    patch = quadrilateral_coverage(BENT, target, sides, 1.1)
    brute = supersampled_coverage(BENT, target, patch.rows, patch.columns, 1.1, 16)
    assert brute.max() > 0.1, "the window misses the cell"
    np.testing.assert_allclose(patch.coverage, brute, rtol=0, atol=2e-3)
    assert abs((patch.coverage - brute).mean()) < 5e-5


def test_coverage_adds_up_to_the_projected_area():
    """Blur conserves light: the total coverage is the area inside the bent outline.

    The profile of the tangent line replaces that of the bent side, which displaces it by half the
    curvature times the blur squared: 4e-5 px here.
    """
    target = bent_target()
    corners = target.outlines()[0]
    patch = quadrilateral_coverage(BENT, target, sides_of(corners), 0.9)
    t = np.linspace(0.0, 1.0, 4001)[:-1, None]
    outline = BENT.project(
        target.to_camera(
            np.concatenate([corners[i] + t * (corners[i - 3] - corners[i]) for i in range(4)])
        )
    )
    x, y = outline.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    perimeter = np.hypot(*(outline - np.roll(outline, 1, axis=0)).T).sum()
    assert abs(patch.coverage.sum() - area) / perimeter < 6e-5


@pytest.mark.parametrize("tone", ["linear", "srgb", 2.2])
def test_tone_curves_invert_and_srgb_is_the_standard_one(tone):
    coded = np.linspace(0.0, 1.0, 1001)
    np.testing.assert_allclose(encode_tone(decode_tone(coded, tone), tone), coded, atol=1e-7)
    assert decode_tone(np.array([0.5]), "srgb")[0] == pytest.approx(0.21404114, abs=1e-8)


def flat_scene(**kinds):
    """A square facing an ideal camera, with its corners at known pixels."""
    camera = TrueCamera(400.0, 400.0, 99.5, 74.5, image_size=(200, 150))
    return Scene(camera, (Target(np.eye(3), np.array([0.0, 0.0, 4.0]), **kinds),))


@pytest.mark.parametrize("tone", ["linear", "srgb"])
def test_levels_and_noise_are_in_grey_levels(tone):
    rng = np.random.default_rng(4)
    picture = render(flat_scene(), rng, noise=3.0, contrast=175.0, tone=tone, dtype=np.float32)
    figure, ground = 255.0 * picture[60:90, 80:120], 255.0 * picture[:20]
    assert figure.mean() == pytest.approx(40.0, abs=4 * 3.0 / np.sqrt(figure.size))
    assert ground.mean() == pytest.approx(215.0, abs=4 * 3.0 / np.sqrt(ground.size))
    assert ground.std() == pytest.approx(3.0, rel=4 / np.sqrt(2 * ground.size))


def test_edges_fall_midway_in_light_and_off_midway_when_coded():
    """The square spans 100 px, from 49.5: pixels 49.5 +- 0.5 are mirror images in linear light."""
    row = 74
    linear = render(flat_scene(), np.random.default_rng(0), noise=0.0, dtype=np.float32)[row]
    assert linear[49] + linear[50] == pytest.approx(1.0, abs=1e-6)
    coded = render(
        flat_scene(), np.random.default_rng(0), noise=0.0, tone="srgb", dtype=np.float32
    )[row]
    assert coded[49] + coded[50] > 1.05


def test_frame_is_the_square_without_its_middle():
    square, frame = (
        render(flat_scene(kind=kind, inner=0.5), np.random.default_rng(0), noise=0.0)
        for kind in ("square", "frame")
    )
    assert np.all(square[70:80, 80:120] == 40)
    assert np.all(frame[70:80, 80:120] == 215)
    assert np.all(frame[70:80, 55:70] == 40)


def test_light_figures_are_the_negative_of_dark_ones():
    dark, light = (
        render(flat_scene(dark=dark), np.random.default_rng(0), noise=0.0).astype(int)
        for dark in (True, False)
    )
    assert np.abs(dark + light - 255).max() <= 1


def test_chessboard_corners_are_where_opencv_finds_them():
    camera = TrueCamera(900.0, 902.0, 640.0, 470.0, np.array([-0.1, 0.02, 0.0, 0.0, 0.0]))
    scene = simulate.chessboard_scene(np.random.default_rng(6), camera)
    picture = render(scene, np.random.default_rng(7), noise=0.5)
    truth = scene.image_points(0, scene.targets[0].board_corners())
    found, corners = cv2.findChessboardCornersSB(picture, (9, 6))
    assert found
    gaps = np.hypot(*(corners.reshape(-1, 1, 2) - truth).transpose(2, 0, 1)).min(axis=1)
    assert np.median(gaps) < 0.1


def test_picture_types_and_colour():
    scene = flat_scene()
    deep = render(scene, np.random.default_rng(0), noise=0.0, dtype=np.uint16)
    assert deep.dtype == np.uint16
    assert deep[0, 0] == 215 * 257
    colour = render(scene, np.random.default_rng(0), noise=0.0, colour=True)
    assert colour.shape == (150, 200, 3)
    assert len(set(colour[0, 0].tolist())) > 1
    coded = render(scene, np.random.default_rng(0), jpeg_quality=40)
    plain = render(scene, np.random.default_rng(0))
    assert coded.shape == plain.shape
    assert 0 < np.abs(coded.astype(int) - plain).max() < 60


def test_shading_dims_one_end():
    even = render(flat_scene(), np.random.default_rng(0), noise=0.0)
    shaded = render(flat_scene(), np.random.default_rng(0), noise=0.0, shading=0.5)
    ratio = shaded[even == 215] / 215.0
    assert ratio.max() > 0.99
    assert ratio.min() == pytest.approx(0.5, abs=0.01)


def squares_mask(scene, scale):
    """Pixels inside the scene's squares, each scaled about its centre."""
    mask = np.zeros((960, 1280), np.uint8)
    for i, target in enumerate(scene.targets):
        outline = scene.image_points(i, scale * target.outlines()[0])
        cv2.fillPoly(mask, [np.rint(outline).astype(np.int32)], 1)
    return mask.astype(bool)


def test_render_into_touches_only_the_sheets_and_keeps_them_clean():
    rng = np.random.default_rng(8)
    scene = random_scene(rng)
    photo = rng.integers(0, 256, (960, 1280, 3), dtype=np.uint8)
    into = simulate.render_into(photo, scene, rng, noise=0.0, contrast=151.0)
    beyond = ~squares_mask(scene, 1.45)
    np.testing.assert_array_equal(into[beyond], photo[beyond])
    paper_and_ink = into[squares_mask(scene, 1.1)]
    assert np.ptp(paper_and_ink, axis=1).max() == 0, "the photograph's colours shine through"
    assert paper_and_ink.min() == 52
    assert paper_and_ink.max() <= 203
    assert np.median(into[squares_mask(scene, 0.9)]) == 52


def test_clutter_stays_off_the_paper():
    """Two pictures that differ only in clutter agree on every square and just around it."""
    scene = random_scene(np.random.default_rng(9))
    pictures = [
        render(scene, np.random.default_rng(seed), noise=0.0, clutter=60) for seed in (1, 2)
    ]
    sheets = squares_mask(scene, 1.1)
    difference = np.abs(pictures[0].astype(int) - pictures[1])
    assert difference[sheets].max() < 20
    assert difference[~sheets].mean() > 10


def test_same_seed_same_picture():
    size = (320, 240)
    first, second = (simulate.photo_like(np.random.default_rng(11), size) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    assert first[2] == second[2]
    third = simulate.photo_like(np.random.default_rng(12), size)
    assert np.any(first[0] != third[0])


def test_impossible_requests_are_refused():
    scene = flat_scene()
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="blur"):
        render(scene, rng, blur=0.0)
    with pytest.raises(ValueError, match="background"):
        render(scene, rng, background=np.zeros((10, 10), np.uint8))
    with pytest.raises(ValueError, match="dtype"):
        render(scene, rng, dtype=np.int16)
