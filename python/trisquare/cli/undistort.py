"""`trisquare undistort`: photographs and videos without their lens's distortion."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import nullcontext
from functools import lru_cache, partial
from itertools import compress
from pathlib import Path
from typing import Any

from trisquare._support.paths import naming
from trisquare._support.suggestions import unknown
from trisquare._support.writing import making_folder, write_in_turn
from trisquare.camera.angles_of_view import angles_of_view
from trisquare.camera.camera import Camera
from trisquare.camera.camera_of import camera_of
from trisquare.camera.members import camera_members
from trisquare.camera.panorama import HIGHEST_LATITUDES, Panorama
from trisquare.camera.projection_uncertainty import known_part
from trisquare.cli.camera_file import camera_content, camera_format
from trisquare.cli.console import answer, coded_lines, progress_bar, texts_and_codes
from trisquare.cli.input_files import photographs_named, read_camera
from trisquare.cli.options import BALANCE, JSON, PHOTOS, QUIET, flag, option
from trisquare.cli.pictures_drawn import (
    check_depth,
    check_file_named,
    check_outputs,
    numbered_paths,
)
from trisquare.images.encoding import encode_turned
from trisquare.images.frame_choice import check_named_video
from trisquare.images.pixels import picture_size
from trisquare.images.reading import read_photograph
from trisquare.images.video import Video, add_sound, check_video_name, is_video
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.undistortion.undistort import (
    INTERPOLATIONS,
    Interpolation,
    Undistorter,
    checked_interpolation,
)
from trisquare.undistortion.video import undistort_video

VIEWS = ("pinhole", *HIGHEST_LATITUDES)

UNDISTORTION_FORMAT = "trisquare-undistortion/1"

OF_THE_RIM = ("lens_extrapolated", "lens_ends_in_picture")
"""Warnings of a calibration that also concern undistorted pictures."""

WIDE_FIELD = 120.0
"""Angle of view, degrees, above which a pinhole's picture is mostly its stretched border."""

EXAMPLES = (
    "trisquare undistort photo.jpg --camera camera.json -o straight.jpg",
    "trisquare undistort frame-*.png --camera camera.json -o straight/ --balance 0.5",
    "trisquare undistort wide.png --camera camera.json -o wide-view.png --view equirectangular",
    "trisquare undistort small.png --camera camera.json -o straight.png --rescale",
    "trisquare undistort clip.mp4 --camera camera.json -o straight.mp4",
    "trisquare undistort photo.jpg --camera camera.json -o straight.jpg --new-camera pinhole.json",
)


def undistort_command(
    photos: list[Path] = PHOTOS,
    camera: Path = option(..., "FILE", "The camera, in any format that convert reads."),
    output: str = option(
        ...,
        "FILE",
        "Write the picture to this file. With several photographs, FILE.png becomes FILE-1.png, "
        "FILE-2.png, ...; in a folder (FOLDER/ is made), each keeps its own name. Videos are "
        "written as .mp4, .mov or .avi.",
        "--output",
        "-o",
    ),
    balance: float = BALANCE,
    view: str = option(
        "pinhole",
        "VIEW",
        "pinhole, or for wide lenses cylinder or equirectangular (a sphere).",
        offer=VIEWS,
    ),
    field: float | None = option(
        None,
        "DEGREES",
        "Field of view, instead of --balance; by default a cylinder or a sphere shows all of the "
        "photograph's row through the principal point.",
    ),
    rescale: bool = flag(
        "Scale the camera to photographs of another resolution but the same aspect ratio: "
        "fx' = s fx, cx' = s (cx + 1/2) - 1/2.",
        "--rescale",
    ),
    interpolation: str = option(
        "linear", "HOW", "linear, nearest, cubic or lanczos.", offer=INTERPOLATIONS
    ),
    new_camera: Path | None = option(
        None,
        "FILE",
        "Write the camera of the new pictures, a pinhole, to this file, in the format of its "
        "name, as convert does.",
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Remove the lens distortion from photographs and videos; none is written unless all can be.

    Of a photograph's Exif block the orientation tag alone is kept, in JPEG and PNG: its focal
    length and its preview are not the new picture's. JPEG has quality 95; PNG and TIFF lose
    nothing.

    A video keeps the mean rate and the number of its frames, and its sound where ffmpeg is on the
    PATH.
    """
    photos = photographs_named(photos)
    for photo in photos:
        check_named_video(photo)
    into_folder = output.endswith(("/", os.sep)) or os.path.isdir(output)
    paths = _output_paths(output, photos, into_folder=into_folder)
    resampling = checked_interpolation(interpolation)  # before any photograph is read
    _check_view(view, balance, new_camera)
    known = read_camera(camera)
    lens = camera_of(known)
    undistorter_of = _undistorters(lens, view, balance, field, rescale=rescale)
    done = _Undistorted(undistorter_of, resampling)
    with (
        making_folder(output) if into_folder else nullcontext(),
        progress_bar("undistorting", quiet) as progress,
    ):
        _check_files(photos, paths, camera, new_camera)
        undistorter_of(lens.image_size)  # errors of the view must not name a photograph
        write_in_turn(done.contents(photos, paths, new_camera, progress))
    warnings = [
        *done.warnings,
        *_warnings_of_camera(camera, known),
        *_warnings_of_views(lens, done),
    ]
    members = {
        "format": UNDISTORTION_FORMAT,
        "view": view,
        "balance": balance,
        "field": field,
        "pictures": done.pictures,
        "new_camera": None if new_camera is None else str(new_camera),
        **texts_and_codes(warnings),
    }
    answer(json, quiet, members, _lines(done.pictures, new_camera), coded_lines(warnings))


def _output_paths(output: str, photos: Sequence[Path], *, into_folder: bool) -> list[Path]:
    """Return the output path of each photograph or video."""
    check_file_named(output)
    if into_folder:
        return [Path(output, photo.name) for photo in photos]
    if not (Path(output).suffix or any(map(is_video, photos))):
        raise ValueError(
            f"{output}: write a folder as {output}/, and a picture with its extension, such as "
            f"{output}.png"
        )
    return numbered_paths(Path(output), len(photos))


def _check_view(view: str, balance: float, new_camera: Path | None) -> None:
    """Check that options for a pinhole are given only with a pinhole."""
    if view not in VIEWS:
        raise unknown("view", view, VIEWS)
    if balance and view != "pinhole":
        raise ValueError(f"--balance is for a pinhole: of --view {view} give --field")
    if new_camera is not None:
        if view != "pinhole":
            raise ValueError(f"--new-camera is for a pinhole: no format stores --view {view}")
        camera_format(new_camera)


def _check_files(
    photos: Sequence[Path], paths: Sequence[Path], camera: Path, new_camera: Path | None
) -> None:
    """Refuse output files that cannot be written, before anything is computed."""
    moving = list(compress(paths, map(is_video, photos)))
    still = [path for path in paths if path not in moving]
    check_outputs([*photos, camera], still, [*moving, new_camera])
    for path in moving:
        check_video_name(path)


def _undistorters(
    lens: Camera, view: str, balance: float, field: float | None, *, rescale: bool
) -> Callable[[tuple[int, int]], Undistorter]:
    """Return a function that returns the undistorter for photographs of a size."""

    @lru_cache(maxsize=1)
    def undistorter_of(size: tuple[int, int]) -> Undistorter:
        taken_by = lens.rescaled(size) if rescale and size != lens.image_size else lens
        if view == "pinhole":
            return Undistorter(taken_by, new_camera=taken_by.undistorted(balance, field=field))
        return Undistorter(taken_by, new_camera=Panorama.of(taken_by, view, field))

    return undistorter_of


class _Undistorted:
    """Pictures that have been undistorted so far.

    Parameters
    ----------
    undistorter_of : callable
        Returns the undistorter for a size of photographs.
    interpolation : str
        One of `INTERPOLATIONS`.

    Attributes
    ----------
    pictures : list of dict
        Members of the pictures in the answer.
    views : set of Camera or Panorama
        The cameras of the undistorted pictures.
    warnings : list of CalibrationWarning
    """

    def __init__(
        self,
        undistorter_of: Callable[[tuple[int, int]], Undistorter],
        interpolation: Interpolation,
    ) -> None:
        self._undistorter_of = undistorter_of
        self._interpolation = interpolation
        self.pictures: list[dict[str, Any]] = []
        self.views: set[Camera | Panorama] = set()
        self.warnings: list[CalibrationWarning] = []

    def contents(
        self,
        photos: Sequence[Path],
        paths: Sequence[Path],
        new_camera: Path | None,
        progress: Callable[[int, int], None] | None,
    ) -> Iterator[tuple[Path, bytes | Callable[[Path], None]]]:
        """Undistort one photograph after another, as each is written."""
        for photo, path in zip(photos, paths, strict=True):
            if is_video(photo):
                yield path, partial(self._write_video, photo, path, progress)
                continue
            if progress is not None:
                progress(len(self.pictures), len(photos))
            yield path, self._photograph(photo, path)
        if new_camera is not None:
            yield new_camera, _camera_file(self.views, new_camera)

    def _photograph(self, photo: Path, path: Path) -> bytes:
        """Undistort a photograph and return the content of the output file."""
        picture, tag = read_photograph(photo)
        check_depth(picture, path)
        with naming(photo):
            used = self._undistorter_of(picture_size(picture))
            straight = used.undistort(picture, interpolation=self._interpolation)
        self._add(photo, path, used)
        encoded, missed = encode_turned(straight, path, tag)
        if missed is not None:
            self.warnings.append(CalibrationWarning(missed, "orientation_lost"))
        return encoded

    def _write_video(
        self, clip: Path, path: Path, progress: Callable[[int, int], None] | None, temporary: Path
    ) -> None:
        """Write an undistorted video to a temporary file, which later replaces that of the path."""
        with Video(clip) as video, naming(clip):
            used = self._undistorter_of(video.size)

            def tell(done: int) -> None:
                if progress is not None:
                    progress(done, video.frames_in_all(done))

            frames = undistort_video(
                video, used, temporary, interpolation=self._interpolation, progress=tell
            )
        self._add(
            clip,
            path,
            used,
            frames=frames,
            rate=video.rate,
            turned=video.turn,
            unevenness_s=video.unevenness,
        )
        self.warnings += _warnings_of_video(video, path)
        missed = add_sound(temporary, clip)
        if missed is not None:
            self.warnings.append(CalibrationWarning(f"{path}: {missed}", "sound_lost"))

    def _add(self, photo: Path, path: Path, used: Undistorter, **more: Any) -> None:
        self.pictures.append({**_picture_members(photo, path, used), **more})
        self.views.add(used.new_camera)


def _warnings_of_video(video: Video, path: Path) -> Iterator[CalibrationWarning]:
    if video.turn:
        text = (
            f"{path}: turned clockwise by {video.turn} degrees, as players turn the video; the "
            "new camera is that of its frames before"
        )
        yield CalibrationWarning(text, "video_turned")
    if video.unevenness * video.rate > 1.0:
        text = (
            f"{path}: has {video.rate:.4g} frames a second; those of the video come unevenly, "
            f"and are up to {video.unevenness:.2g} s earlier or later than here"
        )
        yield CalibrationWarning(text, "uneven_frames")


def _warnings_of_camera(camera: Path, known: Calibration | Camera) -> Iterator[CalibrationWarning]:
    """Yield a calibration's warnings that also concern undistorted pictures."""
    for item in known.warnings if isinstance(known, Calibration) else ():
        if item.code in OF_THE_RIM or item.severity == "high":
            yield CalibrationWarning(f"{camera}: {item}", item.code, item.severity)


def _warnings_of_views(lens: Camera, done: _Undistorted) -> Iterator[CalibrationWarning]:
    """Yield warnings of a part of the photographs that is left out, and of too wide a pinhole."""
    unknown_part = 1.0 - known_part(lens)
    # Without black pixels nothing is missing: a narrow view was asked for.
    has_black = any(item["valid_rectangle"][2:] != item["image_size"] for item in done.pictures)
    if unknown_part > 0.0 and has_black:
        text = (
            f"{100.0 * unknown_part:.2g} % of the photograph is left out: it lies beyond the "
            "camera's valid radius, where the lens is not known; calibrate with targets nearer to "
            "the corners, or with fewer coefficients"
        )
        yield CalibrationWarning(text, "part_left_out")
    seen = [angles_of_view(view) for view in done.views if isinstance(view, Camera)]
    widest = max((angles[0] for angles in seen if angles is not None), default=0.0)
    if widest > WIDE_FIELD:
        text = (
            f"the new camera sees {widest:.0f} degrees, which a pinhole stretches toward the "
            "border: give --view cylinder, or a smaller --field"
        )
        yield CalibrationWarning(text, "wide_pinhole")


def _camera_file(views: Collection[Camera | Panorama], path: Path) -> bytes:
    """Return the content of the file of the camera of all new pictures, which must be one."""
    if len(views) > 1:
        raise ValueError(
            f"{path}: photographs of {len(views)} sizes have as many new cameras: undistort those "
            "of one size at a time"
        )
    (pinhole,) = views
    assert isinstance(pinhole, Camera)
    return camera_content(pinhole, path)


def _picture_members(photo: Path, path: Path, undistorter: Undistorter) -> dict[str, Any]:
    """Return the entry of a photograph or a video in ``pictures``."""
    return {
        "photo": str(photo),
        "output": str(path),
        "image_size": list(undistorter.new_camera.image_size),
        **_view_members(undistorter.new_camera),
        "valid_rectangle": list(undistorter.valid_rectangle),
    }


def _view_members(view: Camera | Panorama) -> dict[str, Any]:
    """Return the member ``camera`` or ``panorama`` of a picture."""
    if isinstance(view, Camera):
        return {"camera": camera_members(view)}
    names = ("projection", "focal", "cx", "cy")
    return {"panorama": {name: getattr(view, name) for name in names}}


def _lines(pictures: Sequence[dict[str, Any]], new_camera: Path | None) -> Iterator[str]:
    """Describe the written files; consecutive files with the same camera share its line."""
    before = None
    for picture in pictures:
        camera = picture.get("camera") or picture["panorama"]
        if camera != before:
            width, height = picture["image_size"]
            x, y, valid_width, valid_height = picture["valid_rectangle"]
            names = ("fx", "fy", "focal", "cx", "cy")
            numbers = ", ".join(f"{name} {camera[name]:.6g}" for name in names if name in camera)
            view_name = camera.get("projection", "new camera")
            is_lost = new_camera is None and "projection" not in camera
            hint = " (--new-camera FILE keeps it)" if is_lost else ""
            yield f"{view_name}, without distortion: {width} x {height}, {numbers}{hint}"
            rectangle = f"({x}, {y}) of {valid_width} x {valid_height}"
            yield f"no black border in the rectangle from {rectangle}"
        before = camera
        yield f"wrote {picture['output']}"
    if new_camera is not None:
        yield f"wrote {new_camera}"
