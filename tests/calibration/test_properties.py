"""Properties of every scene, and limits on the effect of any input."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
from trisquare.camera.camera import camera_parameters

SCENES = [squares(seed, kind="square" if seed % 2 else "frame") for seed in range(60, 64)]
EDGES = [edges_of(scene, 0.05, spacing=12.0) for scene in SCENES]
RESULTS = [ts.calibrate_edges(edges, IMAGE_SIZE) for edges in EDGES]

numbered_scenes = st.sampled_from(range(len(SCENES)))
few = settings(max_examples=25)
some = settings(max_examples=50)
many = settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])


def with_points(figure, change, lines=None):
    return ts.PlaneEdges(
        figure.lines if lines is None else lines,
        [change(points) for points in figure.points],
        plane=figure.plane,
        freedom=figure.freedom,
    )


def assert_same(result, expected, tolerance=1e-2):
    """Check equality to a fraction of the standard deviations, which an iteration may leave."""
    found, wanted = camera_parameters(result.camera), camera_parameters(expected.camera)
    for name, std in expected.std.items():
        assert abs(found[name] - wanted[name]) < tolerance * std
        assert result.std[name] == pytest.approx(std, rel=0.1 * tolerance)


# Symmetries.


@few
@given(numbered_scenes, st.data())
def test_the_labels_of_a_square_do_not_matter(number, data):
    """Neither the first side nor the direction of the order matters."""
    relabelled = []
    first, way = 0, 1
    for figure in EDGES[number]:
        # The same for both outlines of a frame: they share the plane's axes.
        if figure.freedom == "auto":
            first = data.draw(st.integers(0, 3))
            way = data.draw(st.sampled_from([1, -1]))
        sides = [figure.points[(first + way * i) % 4] for i in range(4)]
        relabelled.append(ts.PlaneEdges.square(sides, plane=figure.plane, freedom=figure.freedom))
    assert_same(ts.calibrate_edges(relabelled, IMAGE_SIZE), RESULTS[number])


@few
@given(numbered_scenes, st.integers(0, 999))
def test_the_order_of_samples_hardly_matters(number, seed):
    """The first stages thin out long sides, so that the robust scale starts from another value."""
    rng = np.random.default_rng(seed)
    edges = [with_points(figure, rng.permutation) for figure in EDGES[number]]
    assert_same(ts.calibrate_edges(edges, IMAGE_SIZE), RESULTS[number], tolerance=0.1)


@few
@given(numbered_scenes, st.permutations(range(3)), st.integers(-(2**70), 2**70))
def test_the_order_and_numbers_of_planes_do_not_matter(number, order, offset):
    groups = [[f for f in EDGES[number] if f.plane == plane] for plane in order]
    figures = [
        ts.PlaneEdges(f.lines, f.points, plane=f.plane + offset, freedom=f.freedom)
        for group in groups
        for f in group
    ]
    result = ts.calibrate_edges(figures, IMAGE_SIZE)
    assert_same(result, RESULTS[number])
    for plane, old in zip(result.planes, order, strict=True):
        np.testing.assert_allclose(plane.corners, RESULTS[number].planes[old].corners, atol=1e-5)


@few
@given(numbered_scenes, st.sampled_from([0.25, 0.5, 2.0, 4.0]))
def test_a_larger_picture_has_a_larger_camera(number, scale):
    """With (0, 0) at the centre of a pixel, the picture's corner is at -1/2."""
    size = (int(scale * IMAGE_SIZE[0]), int(scale * IMAGE_SIZE[1]))
    edges = [with_points(f, lambda p: scale * (p + 0.5) - 0.5) for f in EDGES[number]]
    camera = ts.calibrate_edges(edges, size).camera
    expected = RESULTS[number].camera
    K = np.array(expected.K)
    K[:2, 2] += 0.5
    K[:2] *= scale
    K[:2, 2] -= 0.5
    std = RESULTS[number].std["fx"]
    np.testing.assert_allclose(camera.K, K, atol=1e-2 * scale * std)
    np.testing.assert_allclose(
        camera.distortion, expected.distortion, atol=1e-2 * RESULTS[number].std["k2"]
    )


@few
@given(numbered_scenes, st.sampled_from(["x", "y", "both"]))
def test_a_mirrored_picture_has_a_mirrored_camera(number, axes):
    """The sides then run in the other direction; a turn by 180 degrees mirrors twice."""
    flip = np.array([axes != "y", axes != "x"])
    far = np.array(IMAGE_SIZE) - 1
    edges = [
        ts.PlaneEdges.square(
            [np.where(flip, far - points, points) for points in f.points],
            plane=f.plane,
            freedom=f.freedom,
        )
        for f in EDGES[number]
    ]
    result = ts.calibrate_edges(edges, IMAGE_SIZE)
    K = np.array(RESULTS[number].camera.K)
    K[:2, 2] = np.where(flip, far - K[:2, 2], K[:2, 2])
    np.testing.assert_allclose(result.camera.K, K, atol=1e-2 * RESULTS[number].std["fx"])
    for name, std in RESULTS[number].std.items():
        assert result.std[name] == pytest.approx(std, rel=1e-3)


@few
@given(numbered_scenes, st.floats(1e-3, 1e3), st.floats(0, 6.3), st.floats(-2, 2))
def test_the_coordinates_on_a_plane_do_not_matter(number, scale, angle, shift):
    """A plane's own lines may be moved, turned and scaled; the camera is the same."""
    c, s = np.cos(angle), np.sin(angle)
    similarity = np.diag([scale, scale, 1]) @ [[c, -s, shift], [s, c, 1], [0, 0, 1]]
    figures = [f for f in EDGES[number] if f.freedom == "auto"]
    expected = ts.calibrate_edges(figures, IMAGE_SIZE)
    moved = [
        ts.PlaneEdges(f.lines @ np.linalg.inv(similarity), f.points, plane=f.plane) for f in figures
    ]
    assert_same(ts.calibrate_edges(moved, IMAGE_SIZE), expected)


# Garbage.


def assert_finite(result):
    numbers = [result.camera.K, result.camera.distortion, result.covariance, result.rms]
    for plane in result.planes:
        numbers += [plane.corners, plane.rotation, plane.translation, plane.rms]
    assert all(np.isfinite(number).all() for number in numbers)
    assert all(std >= 0 for std in result.std.values())
    assert ts.Calibration.from_json(result.to_json()).to_json() == result.to_json()


coordinates = st.one_of(
    st.floats(0, 1280), st.floats(-1e9, 1e9), st.integers(0, 4).map(float), st.floats()
)
sides = arrays(np.float64, st.tuples(st.integers(0, 12), st.just(2)), elements=coordinates)
lines = arrays(np.float64, st.tuples(st.integers(0, 6), st.just(3)), elements=st.floats(-3, 3))


@pytest.mark.slow
@many
@given(
    st.lists(st.tuples(lines, st.lists(sides, max_size=6)), max_size=4),
    st.sampled_from(["ml", "linear"]),
    st.sampled_from(["none", "radial2", "brown"]),
    st.sampled_from([(), "aspect", "principal_point", ("aspect", "principal_point", "distortion")]),
)
def test_garbage_is_refused_or_gives_finite_numbers(figures, method, model, fix):
    try:
        edges = [ts.PlaneEdges(own, points[: len(own)]) for own, points in figures]
        assert_finite(ts.calibrate_edges(edges, IMAGE_SIZE, method=method, model=model, fix=fix))
    except (ts.TrisquareError, ValueError, TypeError):
        pass


@pytest.mark.slow
@many
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0, 3).map(lambda power: 10.0**power),
    st.sampled_from(["ml", "linear"]),
    st.sampled_from(["none", "radial1", "radial2", "radial3", "brown"]),
)
def test_ruined_squares_are_refused_or_give_finite_numbers(seed, disturbance, method, model):
    """Squares whose samples are scattered by up to the size of the picture."""
    rng = np.random.default_rng(seed)
    edges = [
        with_points(f, lambda p: p[::3] + disturbance * rng.standard_normal(p[::3].shape))
        for f in EDGES[seed % len(EDGES)]
    ]
    try:
        assert_finite(ts.calibrate_edges(edges, IMAGE_SIZE, method=method, model=model))
    except ts.TrisquareError:
        pass
    except ValueError as error:
        # All samples of a figure may be outside the picture.
        if "wholly outside the picture" not in str(error):
            raise


@some
@given(st.lists(sides, max_size=5), st.integers(1, 3))
def test_the_straightening_of_garbage(curves, count):
    try:
        found = ts.fit_distortion(curves, IMAGE_SIZE, count)
        assert np.isfinite([*found.coefficients, *found.centre, found.rms]).all()
        assert np.isfinite(found.undistort([[639.5, 479.5], [600.0, 400.0]])).all()
    except (ts.TrisquareError, ValueError):
        pass


# All dtypes and memory layouts of numpy.
DTYPES = ["u1", "<u2", ">u2", "<f4", ">f4", "f8", "f2", "i1", "i4", "?", "c8", "O", "S1", "M8[s]"]
LAYOUTS = {
    "as it is": lambda image: image,
    "turned": lambda image: image[::-1, ::-1],
    "transposed": lambda image: image.T,
    "every second": lambda image: image[::2, ::2],
    "one row": lambda image: np.broadcast_to(image[:1], image.shape),
    "not an image": lambda image: image[..., None, None],
    "flat": np.ravel,
}


@pytest.mark.slow
@many
@given(
    st.sampled_from(DTYPES),
    st.tuples(st.integers(0, 48), st.integers(0, 48)),
    st.sampled_from([(), (0,), (1,), (2,), (3,), (4,)]),
    st.sampled_from(sorted(LAYOUTS)),
    st.integers(0, 2**32 - 1),
    st.booleans(),
    st.sampled_from(["auto", "chessboard:3x3"]),
)
def test_any_array_is_refused_or_searched(dtype, size, channels, layout, seed, write, targets):
    noise = np.random.default_rng(seed).integers(0, 256, (*size, *channels))
    if size[0] > 16 and size[1] > 16:
        noise[8:-8, 8:-8] //= 8  # a dark rectangle
    image = LAYOUTS[layout](noise.astype(dtype))
    image.flags.writeable = write and image.flags.writeable
    before = image.tobytes()
    with suppress(ts.TrisquareError, ValueError, TypeError):
        assert_finite(ts.calibrate(image, targets=targets))
    with suppress(ts.TrisquareError, ValueError, TypeError):
        for figure in ts.detect(image, targets=targets):
            assert all(np.isfinite(points).all() for points in figure.points)
    assert image.tobytes() == before


matrices = arrays(np.float64, (3, 3), elements=st.one_of(st.floats(-5, 5), st.floats()))


@some
@given(st.lists(matrices, max_size=4), matrices, lines, lines)
def test_the_other_steps_of_garbage(homographies, K, plane_lines, image_lines):
    for call in (
        lambda: ts.camera_matrix_from_homographies(homographies),
        lambda: ts.homography_from_lines(plane_lines, image_lines),
        lambda: np.column_stack(ts.pose_from_homography(K, homographies[0] if homographies else K)),
    ):
        with suppress(ts.TrisquareError, ValueError):
            assert np.isfinite(call()).all()
