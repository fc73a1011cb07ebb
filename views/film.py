"""Films of motions: MuJoCo's renderer off screen, which needs a GL library, and ffmpeg, by which frames
are written as MP4; pictures and pages need neither.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path as File
from subprocess import PIPE, Popen
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb as rgb, to_rgba
from numpy.typing import NDArray
from PIL import Image

from stancekit.planners.errors import InvalidInput, installed, not_installed
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.writing import check_writable, failure_of, replaced

from .scene import (
    Animation,
    Box,
    Camera,
    Capsule,
    Colour,
    DrawnBody,
    Faces,
    Facet,
    Mesh,
    Path,
    Scene,
    Sheet,
    Sphere,
    borders,
    fans,
    triangles_of,
)
from .sheet import DEFAULT_STYLE, Size, headline, sheet, to_rgb
from .still import GLASS, is_glass, normals_of

Frame = NDArray[np.uint8]


def check_video(path: str | File) -> File:
    """The file behind the name of a video, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .mp4, where nothing can be written, and
    without ffmpeg.
    """
    if File(path).suffix.lower() != ".mp4":
        raise InvalidInput(
            f"{path}: expected a name that ends in .mp4, got {File(path).suffix or 'no suffix'}"
        )
    _ffmpeg()
    return check_writable(path)


def write_video(path: str | File, frames: Iterable[Frame], fps: float) -> None:
    """Write frames, one or more, uint8 of shape (H, W, 3) and all of one size, as H.264 in MP4.

    Frames are taken one by one, so a generator needs little memory; an odd last row or column is
    left out, as the format has none. Raises InvalidInput as ``check_video``.
    """
    check_video(path)
    remaining = iter(frames)
    first = next(remaining)
    rows, columns, _ = first.shape
    with replaced(path) as temporary, _encoder(temporary, first, fps) as write:
        for frame in chain([first], remaining):
            write(frame[: rows // 2 * 2, : columns // 2 * 2])


@contextmanager
def _encoder(path: File, first: Frame, fps: float) -> Iterator[Callable[[Frame], object]]:
    """A function that ffmpeg gets frames by.

    Raises OSError where not all of them are in the file at the end.

    imageio_ffmpeg, which brings ffmpeg, keeps its exit status to itself, and so a disk that is full
    at the last block.
    """
    rows, columns = (side // 2 * 2 for side in first.shape[:2])
    options = [
        "-y",
        "-v",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{columns}x{rows}",
        "-r",
        f"{fps:g}",
    ]
    options += [
        "-i",
        "-",
        "-an",
        "-vcodec",
        "libx264",
        "-preset",
        "veryfast",
        "-pix_fmt",
        "yuv420p",
        "-crf",
        "16",
        "-f",
        "mp4",
    ]
    failed = True
    with TemporaryFile() as sink, path.open("r+b") as film:
        # by its descriptor: an ffmpeg that outlives this process makes no file of that name again
        arguments, descriptors = [_ffmpeg(), *options, f"/dev/fd/{film.fileno()}"], (film.fileno(),)
        with Popen(
            arguments, stdin=PIPE, stderr=sink, pass_fds=descriptors, start_new_session=True
        ) as process:
            assert process.stdin is not None
            stream = process.stdin
            try:
                yield lambda frame: stream.write(np.ascontiguousarray(frame).data)
                stream.close()
                failed = process.wait() != 0
            except BrokenPipeError:  # it ended early, and says why
                pass
            except BaseException:  # no encoder is left behind; it is raised again
                process.kill()
                raise
            finally:
                with suppress(OSError):
                    stream.close()
        if failed:
            sink.seek(0)
            raise failure_of("ffmpeg", sink.read().decode(errors="replace"))


def _ffmpeg() -> str:
    """The path of ffmpeg."""
    try:
        return str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise not_installed("video", "ffmpeg", "films", "viz") from None


_FINER = 1.5
"""Rows and columns drawn to a pixel; their mean is what is seen. Twice as many cost half as much again."""
_SHADOW_PX, _SLICES, _STACKS = 512, 14, 8
"""Pixels of the map that says what the light reaches, and faces around and along what is round: the
time of a frame goes there."""
_PROGRESS = 61, 90, 128
"""Red, green and blue of the line at the foot, as long as what was seen of the whole."""
_POINT_M = 0.0006
"""Half the width of a line of one point, as a share of the distance."""
_EMPTY = """<mujoco><visual><headlight active="0"/></visual>
<asset><texture name="sky" type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="8" height="48"/></asset>
<worldbody><light type="directional" castshadow="false" ambient=".78 .78 .78" diffuse="0 0 0" specular="0 0 0"/>
<light type="directional" dir="{} {} {}" pos="{} {} {}" diffuse=".3 .3 .3" specular=".1 .1 .1"/></worldbody></mujoco>"""
_GL = "video: expected a GL library for MuJoCo's renderer; install one, e.g. apt-get install libegl1 libgl1"


def check_film(path: str | File) -> File:
    """The file behind the name of a film, asked for before the work whose result goes there.

    Raises InvalidInput as ``check_video`` does, and without MuJoCo or a GL library.
    """
    target = check_video(path)
    with _renderer(_mujoco().MjSpec().compile(), (8, 8)):
        return target


def film_frames(motion: Animation, size_px: Size, *, foot_px: int = 0) -> Iterator[Frame]:
    """The frames of a film, uint8 of shape (H, W, 3): words above, the scene below, and room at the
    foot.

    The camera follows the robot, which fills half of the height or the width. Raises InvalidInput without MuJoCo or a GL library.
    """
    head_px = round(0.11 * size_px[1])
    view = size_px[0], size_px[1] - head_px - foot_px
    notes = motion.notes or [""] * len(motion.moments)
    words: dict[str, Frame] = {}
    for done, (pixels, note) in enumerate(zip(rendered(motion, view), notes, strict=True), 1):
        if note not in words:
            words = {note: _words(motion, note, size_px)}
        frame = words[note].copy()
        frame[head_px : head_px + view[1]] = pixels
        frame[-3:, : round(size_px[0] * done / len(notes))] = _PROGRESS
        yield frame


def rendered(motion: Animation, size_px: Size) -> Iterator[Frame]:
    """The scene alone, moment by moment, seen by the motion's camera through a window that follows
    the robot.
    """
    stage, windows = _Stage(motion), motion.windows(size_px[0] / size_px[1])
    with _renderer(stage.model, (round(_FINER * size_px[0]), round(_FINER * size_px[1]))) as draw:
        for moment, (low, high) in zip(motion.moments, windows, strict=True):
            pixels = draw(partial(stage.pose, moment=moment, low=low, high=high))
            yield np.array(Image.fromarray(pixels).resize(size_px, Image.Resampling.BOX))


class _Stage:
    """A motion as MuJoCo has it: what stays in a model with all meshes, and what moves put into the
    scene by hand.
    """

    def __init__(self, motion: Animation) -> None:
        self._mujoco, self._camera, self._fixed = _mujoco(), motion.camera, motion.fixed
        light, sun_m = (
            self._camera.light,
            self._camera.target_m + self._camera.distance_m * self._camera.light,
        )
        self._spec = self._mujoco.MjSpec.from_string(_EMPTY.format(*-light, *sun_m))
        self._meshes: dict[int, str] = {}
        for ground in motion.fixed.sheets:
            self._add_sheet(ground)
        flat = _facets(motion.fixed.facets, self._camera)
        for colour, opacity, triangles, normals in [
            *flat,
            *_ribbons(motion.fixed.paths, self._camera),
        ]:
            self._add_geom(meshname=self._add_flat(triangles, normals), rgba=(*colour, opacity))
        for scene in (motion.fixed, *motion.moments):
            for body in scene.bodies:
                if isinstance(body.shape, Mesh) and id(body.shape) not in self._meshes:
                    self._meshes[id(body.shape)] = self._add_mesh(
                        body.shape.vertices_m, body.shape.faces
                    )
        self.model = self._spec.compile()
        self._data = self._mujoco.MjData(self.model)
        self._mujoco.mj_forward(self.model, self._data)

    def pose(self, scene: Any, moment: Scene, low: Array, high: Array) -> None:
        """Fill MuJoCo's scene with a moment, seen through a window of the picture plane, corners of
        shape (2,) [m].
        """
        mujoco = self._mujoco
        mujoco.mjv_updateScene(
            self.model,
            self._data,
            mujoco.MjvOption(),
            None,
            mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_ALL,
            scene,
        )
        self._aim(scene, low, high)
        for each in (self._fixed, moment):
            for body in each.bodies:
                self._put_body(scene, body)
            for arrow in filter(lambda arrow: arrow.visible, each.arrows):
                geom = self._put(
                    scene,
                    mujoco.mjtGeom.mjGEOM_ARROW,
                    np.ones(3),
                    np.zeros(3),
                    np.eye(3),
                    arrow.colour,
                )
                ends = arrow.start_m, arrow.start_m + 2.0 * arrow.vector_m  # it draws half the way
                mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, 1.3 * arrow.radius_m, *ends)

    def _aim(self, scene: Any, low: Array, high: Array) -> None:
        camera = self._camera
        near = 0.05 * camera.distance_m
        for eye in scene.camera:
            eye.pos, eye.forward, eye.up = camera.position_m, -camera.axes[2], camera.axes[1]
            eye.frustum_near, eye.frustum_far = near, 20.0 * camera.distance_m
            (left, bottom), (right, top) = 0.05 * low, 0.05 * high
            eye.frustum_center, eye.frustum_width = 0.5 * (left + right), 0.5 * (right - left)
            eye.frustum_bottom, eye.frustum_top = bottom, top

    def _put_body(self, scene: Any, body: DrawnBody) -> None:
        kinds, casts = self._mujoco.mjtGeom, body.solid
        match body.shape:
            case Capsule(length, radii):
                kind, size = kinds.mjGEOM_CAPSULE, np.array([np.mean(radii), 0.5 * length, 0.0])
            case Sphere(radius):
                kind, size = kinds.mjGEOM_SPHERE, np.full(3, radius)
            case Box(half):
                kind, size = kinds.mjGEOM_BOX, half
            case Mesh():
                self._put_mesh(scene, body).castshadow = casts
                return
        self._put(
            scene, kind, size, body.position_m, body.rotation, body.colour, body.opacity
        ).castshadow = casts

    def _put_mesh(self, scene: Any, body: DrawnBody) -> Any:
        """A mesh, which MuJoCo keeps about its centre and along its axes of inertia."""
        index, matrix = self.model.mesh(self._meshes[id(body.shape)]).id, np.zeros(9)
        self._mujoco.mju_quat2Mat(matrix, self.model.mesh_quat[index])
        centre, turn = (
            body.position_m + body.rotation @ self.model.mesh_pos[index],
            body.rotation @ matrix.reshape(3, 3),
        )
        kind = self._mujoco.mjtGeom.mjGEOM_MESH
        geom = self._put(scene, kind, np.ones(3), centre, turn, body.colour, body.opacity)
        geom.dataid = 2 * index
        return geom

    def _put(
        self,
        scene: Any,
        kind: Any,
        size: Array,
        at: Array,
        turn: Array,
        colour: Colour,
        opacity: float = 1.0,
    ) -> Any:
        """One more shape in the scene."""
        geom = scene.geoms[scene.ngeom]
        rgba = np.array([*rgb(colour), opacity], dtype=np.float32)
        self._mujoco.mjv_initGeom(
            geom, kind, size, np.asarray(at, dtype=np.float64), turn.ravel(), rgba
        )
        geom.castshadow = False
        scene.ngeom += 1
        return geom

    def _add_sheet(self, ground: Sheet) -> None:
        """A surface whose texture has a pixel a node."""
        rows, columns = ground.points_m.shape[:2]
        at = (np.moveaxis(np.indices((rows, columns)), 0, -1) + 0.5) / [rows, columns]
        name = self._add_mesh(
            ground.points_m.reshape(-1, 3), triangles_of(ground.faces), usertexcoord=at.ravel()
        )
        picture = np.round(255.0 * ground.colours.swapaxes(0, 1)).astype(np.uint8)
        texture = self._spec.add_texture(
            name=name,
            type=self._mujoco.mjtTexture.mjTEXTURE_2D,
            width=rows,
            height=columns,
            nchannel=3,
        )
        texture.data = picture.tobytes()
        material = self._spec.add_material(name=name)
        material.textures[self._mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        self._add_geom(meshname=name, material=name)

    def _add_mesh(self, points: Array, faces: Faces, **more: Any) -> str:
        """A mesh of triangles in the model; returns its name."""
        mesh = self._spec.add_mesh(
            name=f"mesh {len(self._spec.meshes)}",
            uservert=points.ravel(),
            userface=faces.ravel().astype(np.int32),
            inertia=self._mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            **more,
        )
        return str(mesh.name)

    def _add_flat(self, triangles: Array, normals: Array) -> str:
        if len(triangles) == 1:  # MuJoCo takes no mesh of three corners
            triangles, normals = triangles.repeat(2, axis=0), normals.repeat(2, axis=0)
        faces = np.arange(3 * len(triangles)).reshape(-1, 3)
        normals = np.repeat(normals, 3, axis=0).ravel()
        indices = faces.ravel().astype(np.int32)
        return self._add_mesh(
            triangles.reshape(-1, 3), faces, usernormal=normals, userfacenormal=indices
        )

    def _add_geom(self, **more: Any) -> None:
        kind = self._mujoco.mjtGeom.mjGEOM_MESH
        self._spec.worldbody.add_geom(type=kind, contype=0, conaffinity=0, castshadow=False, **more)


_Flat = tuple[tuple[float, ...], float, Array, Array]
"""Colour, opacity, triangles of shape (F, 3, 3) [m] and their normals in the light, shape (F,
3)."""


def _facets(facets: Sequence[Facet], camera: Camera) -> list[_Flat]:
    """Facets and their edges; what would hide the robot is glass."""
    seen = [
        replace(
            each,
            opacity=GLASS * each.opacity,
            normal=-each.normal,
            edge=each.edge and (*rgb(each.edge), 0.2 * to_rgba(each.edge)[3]),
        )
        if is_glass(each, camera)
        else each
        for each in facets
    ]
    return [(*key, each, normals_of(each)) for key, each in fans(seen).items()] + _ribbons(
        borders(seen), camera
    )


def _ribbons(paths: Sequence[Path], camera: Camera) -> list[_Flat]:
    """Lines as bands that face the viewer, those of one colour together, a little before what they
    are on.
    """
    ribbons: dict[tuple[tuple[float, ...], float], list[Array]] = {}
    for path in paths:
        a, b = path.pieces_m[:, 0], path.pieces_m[:, 1]
        towards = camera.position_m - a
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        side = np.cross(b - a, towards)
        length = np.linalg.norm(side, axis=1, keepdims=True)
        seen = length[:, 0] > 1e-9
        half = path.width * _POINT_M * camera.distance_m
        side *= half / np.maximum(length, 1e-12)
        a, b = (end + (0.003 + 1.5 * half + min(path.lift_m, 0.02)) * towards for end in (a, b))
        quads = np.stack([a - side, a + side, b + side, b - side], axis=1)[seen]
        triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
        ribbons.setdefault((rgb(path.colour), path.opacity), []).append(triangles)
    joined = {key: np.concatenate(parts) for key, parts in ribbons.items() if sum(map(len, parts))}
    return [
        (*key, each, np.broadcast_to(0.7 * camera.light, (len(each), 3)))
        for key, each in joined.items()
    ]


@contextmanager
def _renderer(model: Any, size_px: Size) -> Iterator[Callable[[Callable[[Any], None]], Frame]]:
    """Yield a function that renders one frame: it lets its argument, a function, fill MuJoCo's
    scene, and returns the picture. Raises InvalidInput without a GL library.
    """
    mujoco, (width, height) = _mujoco(), size_px
    quality = model.vis.quality
    quality.shadowsize, quality.numslices, quality.numstacks = _SHADOW_PX, _SLICES, _STACKS
    model.vis.global_.offwidth, model.vis.global_.offheight, quality.offsamples = *size_px, 0
    backend = os.environ.get("MUJOCO_GL") or ("egl" if sys.platform == "linux" else "")
    try:
        source = (
            import_module(f"mujoco.{backend}")
            if backend in ("egl", "osmesa", "glfw", "cgl")
            else mujoco
        )
        context = source.GLContext(width, height)
        context.make_current()
    except Exception as error:  # every backend and every missing library has its own
        raise InvalidInput(_GL) from error
    try:
        scene = mujoco.MjvScene(model, maxgeom=20_000)
        target = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, target)
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = True
        rect, pixels = (
            mujoco.MjrRect(0, 0, width, height),
            np.empty((height, width, 3), dtype=np.uint8),
        )

        def draw(fill: Callable[[Any], None]) -> Frame:
            fill(scene)
            mujoco.mjr_render(rect, scene, target)
            mujoco.mjr_readPixels(pixels, None, rect, target)
            return pixels[::-1]

        yield draw
    finally:
        context.free()


def _mujoco() -> Any:
    """The module.

    Raises InvalidInput where it is missing.
    """
    return installed("mujoco", "video", "MuJoCo", "frames", "viz")


@DEFAULT_STYLE
def _words(motion: Animation, note: str, size_px: Size) -> Frame:
    """All of a frame but the scene."""
    figure = sheet(size_px, (1280, 720))
    below = "   ·   ".join(filter(None, (motion.note, note)))
    headline(figure, motion.title, below, alarm=motion.alarm)
    return to_rgb(figure)
