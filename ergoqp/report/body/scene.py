"""The 3-D scene of a movement, made with viser: one page with a play bar that needs no server.

Triangle meshes of the shapes of a scene. The body is defined by the capsules of the model. The
drawing differs only in looks: limbs are thinner at their far end, and the rings of the trunk are
joined into one surface.
"""

from __future__ import annotations

import contextlib
import io
import logging
from collections import defaultdict
from collections.abc import Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.errors import MissingExtraError, in_words
from ergoqp.expressions import quaternion_of
from ergoqp.report import palette
from ergoqp.report.between import between, risk_between
from ergoqp.report.body.person import (
    Holder,
    Movement,
    Part,
    Placement,
    Timing,
    parts_of,
    place,
)
from ergoqp.report.body.track import Track, coarse

if TYPE_CHECKING:
    import viser

_LOG: Final = logging.getLogger(__name__)

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices (v, 3) [m] and triangles (f, 3)."""

_AROUND: Final = 24
_ALONG: Final = 7  # rings from the equator to a pole
_NEAR, _FAR = 1.06, 0.74  # radius of a limb at its ends, relative to the model
_LIMBS: Final = ("upper_arm", "forearm", "thigh", "shank")


def body_mesh(parts: Sequence[Part]) -> Mesh:
    """Return the surface of parts with the same owner, in the frame of the owner.

    Args:
        parts: one or more parts; several parts of the trunk become one torso.
    """
    if len(parts) > 1 and all(part.segment == "trunk" and part.capsule for part in parts):
        return _torso(parts)
    return _joined([_part_mesh(part) for part in parts])


def _part_mesh(part: Part) -> Mesh:
    half = float(part.size[1]) if part.capsule else 0.0
    axes = np.full(3, part.size[0]) if part.capsule else part.size
    upper = np.linspace(np.pi / 2, 0, _ALONG)
    latitude = np.concatenate([upper, -upper[::-1]])
    width, height = np.cos(latitude), np.sin(latitude) * axes[2] + np.repeat([half, -half], _ALONG)
    if part.name.endswith(_LIMBS):
        towards_owner = np.sign(-part.position @ part.rotation[:, 2])
        width = width * np.interp(towards_owner * height, [-half, half], [_FAR, _NEAR])
    rings = _rings(np.outer(width, axes[:2]), height)
    return (rings @ part.rotation.T + part.position).astype(np.float32), _between_rings(len(height))


def _torso(parts: Sequence[Part]) -> Mesh:
    """Return one surface through the rings of the trunk, which lie across it (along y)."""
    ordered = sorted(parts, key=lambda part: part.position[2])
    z = np.array([part.position[2] for part in ordered])
    depth = np.array([part.size[0] for part in ordered])
    width = depth + np.array([part.size[1] for part in ordered])
    forward = np.array([part.position[0] for part in ordered])
    # At the ends, the lowest ring extends into the pelvis, and the highest closes over the
    # shoulders.
    heights = np.concatenate(
        [
            [z[0] - depth[0]],
            np.linspace(z[0], z[-1], 18),
            z[-1] + depth[-1] * np.linspace(0.3, 1, 6),
        ]
    )
    over = np.clip((heights - z[-1]) / depth[-1], 0, 1)
    closing = np.sqrt(1 - over**2)
    half_axes = np.stack(
        [
            np.interp(heights, z, depth) * closing,
            np.interp(heights, z, width) - depth[-1] * (1 - closing) - 0.08 * over,
        ],
        axis=1,
    )
    half_axes[-1] = 0.0
    rings = _rings(half_axes, heights)
    rings[:, 0] += np.repeat(np.interp(heights, z, forward), _AROUND)
    # These rings go upwards, so their triangles are flipped to face outwards.
    return rings.astype(np.float32), _between_rings(len(heights))[:, ::-1].copy()


def _joined(meshes: Sequence[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    vertices = np.concatenate([vertices for vertices, _ in meshes])
    faces = np.concatenate(
        [faces + np.uint32(start) for (_, faces), start in zip(meshes, starts, strict=False)]
    )
    return vertices, faces


def _rings(half_axes: NDArray[np.float64], heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points of ellipses with half axes (n, 2) at heights (n,), ring after ring."""
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = (half_axes[:, None, :] * circle).reshape(-1, 2)
    return np.column_stack([flat, np.repeat(heights, _AROUND)])


def _between_rings(count: int) -> NDArray[np.uint32]:
    """Return triangles between successive rings. They face outwards if the rings go down."""
    ring, spoke = np.meshgrid(np.arange(count - 1), np.arange(_AROUND), indexing="ij")
    here, beside = ring * _AROUND + spoke, ring * _AROUND + (spoke + 1) % _AROUND
    quads = np.stack([here, here + _AROUND, beside + _AROUND, beside], axis=-1).reshape(-1, 4)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint32)


_OWN_COLOUR: Final = {"hair": (58, 52, 50), "right_foot": (58, 60, 66), "left_foot": (58, 60, 66)}
_OBJECT_COLOUR: Final = (70, 84, 105)
_SEAT_HEIGHT: Final = 0.05  # height of the cushion [m]
_SEAT_COLOUR: Final = (176, 184, 193)
_PATH_COLOUR: Final = (110, 126, 150)
_FORCE_COLOUR: Final = (194, 65, 12)
_FORCE: Final = 0.004  # length of a force in the scene [m/N]
_LABEL_ABOVE: Final = 0.07  # height of the score above the top of the head [m]


def scene_html(movement: Movement, timing: Timing) -> str:
    """Return the replay as a page of its own.

    A server is started on the loopback interface, because it writes the scene. Nothing
    connects to it, and it is stopped before this function returns.

    Args:
        movement: the movement.
        timing: the samples to show, from `ergoqp.report.body.person.timing_of`.

    Raises:
        MissingExtraError: if viser is not installed.
    """
    try:
        import viser
    except ImportError:
        raise MissingExtraError("the report page", "report", "viser") from None
    shown = movement.at(timing.samples)
    try:
        return _served(shown, timing, quick=True)
    except Exception as error:
        # The messages of a recording are no public part of viser.
        _LOG.info("viser %s: poses are set one by one: %s", viser.__version__, in_words(error))
        return _served(shown, timing, quick=False)


def _served(movement: Movement, timing: Timing, quick: bool) -> str:
    import viser

    # The server prints a message to standard output, which belongs to the calling command.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            return _record(server, movement, timing, quick)
        finally:
            server.stop()


def _record(server: viser.ViserServer, movement: Movement, timing: Timing, quick: bool) -> str:
    placement = place(movement.body, movement.postures, movement.base_poses)
    floor = _floor(movement, placement)
    _set_stage(server, movement, floor)
    actors: list[Any] = [
        _Person(server, movement, placement),
        _Words(server, movement, placement, floor),
    ]
    if movement.object_poses is not None:
        actors.append(_Object(server, movement.object_poses))
        if movement.held:
            person = movement.base_poses[:, :2, 3].mean(axis=0)
            actors.append(Holder(server, movement.object_poses, person, floor))
        if movement.forces is not None:
            actors.append(_Force(server, movement.object_poses, movement.forces))
    for actor in actors:
        actor.show(0)
    recording = server.get_scene_serializer()
    # Nobody is connected, so nothing needs to be sent before the end.
    with server.atomic():
        for frame in range(1, len(movement.time)):
            recording.insert_sleep(timing.frame_time)
            for actor in actors:
                actor.show(frame, recording if quick else None)
    # The last frame stays for its duration before the replay starts again.
    recording.insert_sleep(timing.frame_time)
    return _for_a_page(recording.as_html())


def _for_a_page(scene: str) -> str:
    """Return the scene adapted to be part of a page.

    The mouse wheel scrolls the page until the scene is clicked. The scene has names for screen
    readers, and it is dark if the page is dark.
    """
    own = resources.files("ergoqp.report.body").joinpath("replay.html").read_text(encoding="utf-8")
    end = scene.index("</head>")
    return scene[:end] + own + scene[end:]


def _floor(movement: Movement, placement: Placement) -> float:
    """Return the height of the floor: the lowest height of a sole [m]."""
    model = movement.body.model
    height = min(float(model.site(f"{side}_sole").pos[2]) for side in ("right", "left"))
    feet = [placement.of(f"{side}_ankle_inversion")[0][:, 2] for side in ("right", "left")]
    return float(np.min(feet)) + height


def _set_stage(server: viser.ViserServer, movement: Movement, floor: float) -> None:
    """Add floor, light, and a camera in front and to the right of the person's first direction."""
    pelvis = movement.base_poses[:, :3, 3]
    low, high = pelvis.min(axis=0), pelvis.max(axis=0)
    centre = (low + high) / 2
    spread = float(np.linalg.norm((high - low)[:2]))
    size = float(np.ceil(max(4.0, 2 * spread + 3.0)))
    server.scene.add_grid(
        "/floor",
        width=size,
        height=size,
        cell_size=0.25,
        section_size=1.0,
        position=(centre[0], centre[1], floor),
        # No plane, and lines that are visible on white and on black, because a page may be
        # dark.
        cell_color=(164, 171, 178),
        section_color=(128, 136, 144),
        cell_thickness=0.5,
        plane_opacity=0.0,
    )
    if movement.seated:
        _set_seat(server, np.median(pelvis, axis=0), floor, movement.body.stature)
    server.scene.configure_default_lights(enabled=True, cast_shadow=True)
    forward = movement.base_poses[0, :3, 0]
    right = -movement.base_poses[0, :3, 1]
    middle = np.array([centre[0], centre[1], floor + 0.52 * movement.body.stature]) + 0.12 * forward
    # Close enough for the person to fill the picture, and far enough to show the whole path.
    distance = max(1.6 * movement.body.stature, 0.9 * spread + 1.5)
    direction = 0.75 * forward + 0.85 * right + np.array([0, 0, 0.3])
    camera = server.initial_camera
    camera.fov = float(np.radians(45))
    camera.look_at = middle
    camera.position = middle + distance * direction / np.linalg.norm(direction)


def _set_seat(
    server: viser.ViserServer, pelvis: NDArray[np.float64], floor: float, stature: float
) -> None:
    """Add a stool under the pelvis [m]."""
    top = float(pelvis[2]) - 0.045 * stature
    height = top - floor - _SEAT_HEIGHT
    if height <= 0:
        return
    for name, radius, length, bottom in (
        ("seat", 0.17, _SEAT_HEIGHT, floor + height),
        ("post", 0.035, height, floor),
    ):
        middle = (float(pelvis[0]), float(pelvis[1]), bottom + length / 2)
        server.scene.add_cylinder(
            f"/{name}", radius=radius, height=length, position=middle, color=_SEAT_COLOUR
        )


class _Person:
    """The body: one frame per moving part of the model, and one mesh per score on it."""

    def __init__(self, server: viser.ViserServer, movement: Movement, placement: Placement) -> None:
        self._tracks = [
            Track(server.scene.add_frame(f"/person/{owner}", show_axes=False), *placement.of(owner))
            for owner in placement.owners
        ]
        self._levels = {
            segment: palette.level_of_points(scores).tolist()
            for segment, scores in movement.segments.items()
        }
        self._meshes: list[tuple[str, Any, int]] = []
        groups = defaultdict[tuple[str, str | None, Any], list[Part]](list)
        for part in parts_of(movement.body):
            groups[part.owner, part.segment, _OWN_COLOUR.get(part.name)].append(part)
        for number, ((owner, segment, own), parts) in enumerate(groups.items()):
            vertices, faces = body_mesh(parts)
            level = self._level(segment, 0)
            colour = own or palette.rgb(palette.colour_of_level(level))
            mesh = server.scene.add_mesh_simple(
                f"/person/{owner}/{number}", vertices, faces, color=colour
            )
            if segment is not None:
                self._meshes.append((segment, mesh, level))

    def show(self, frame: int, recording: Any = None) -> None:
        """Move the body to a frame, and update the colours that changed."""
        for track in self._tracks:
            track.show(frame, recording)
        for i, (segment, mesh, before) in enumerate(self._meshes):
            level = self._level(segment, frame)
            if level != before:
                mesh.color = palette.rgb(palette.colour_of_level(level))
                self._meshes[i] = (segment, mesh, level)

    def _level(self, segment: str | None, frame: int) -> int:
        levels = self._levels.get(segment or "")
        return -1 if levels is None else levels[frame]


class _Words:
    """The score above the head and the time on the floor, to the right of the feet."""

    def __init__(
        self, server: viser.ViserServer, movement: Movement, placement: Placement, floor: float
    ) -> None:
        self._movement = movement
        self._score = server.scene.add_label(
            "/score", score_text(movement, 0), anchor="bottom-center", font_screen_scale=1.5
        )
        self._time = server.scene.add_label(
            "/time", _time_text(movement, 0), anchor="top-center", font_screen_scale=1.2
        )
        top = _LABEL_ABOVE + float(movement.body.model.site("head_top").pos[2])
        above, _ = placement.of("head")
        pelvis = movement.base_poses
        beside = pelvis[:, :2, 3] - 0.55 * pelvis[:, :2, 1]
        self._tracks = [
            Track(self._score, above + np.array([0, 0, top])),
            Track(self._time, np.column_stack([beside, np.full(len(beside), floor + 0.02)])),
        ]

    def show(self, frame: int, recording: Any = None) -> None:
        """Show the score and the time of a frame."""
        for track in self._tracks:
            track.show(frame, recording)
        for label, text in ((self._score, score_text), (self._time, _time_text)):
            words = text(self._movement, frame)
            if label.text != words:
                label.text = words


def score_text(movement: Movement, frame: int) -> str:
    """Return the score of a frame in words."""
    score = int(movement.final[frame])
    if not score:
        return "not scored"
    low, high = (score, score) if movement.ends is None else (end[frame] for end in movement.ends)
    return f"REBA {between(str(low), str(high))}, {risk_between(int(low), int(high))}"


def _time_text(movement: Movement, frame: int) -> str:
    return f"{movement.time[frame]:.1f} s"


class _Object:
    """The held object: a small box at the contact, its frame, and its path."""

    def __init__(self, server: viser.ViserServer, poses: NDArray[np.float64]) -> None:
        way = poses[:, :3, 3]
        frame = server.scene.add_frame(
            "/object", axes_length=0.16, axes_radius=0.005, origin_radius=0.009
        )
        self._track = Track(frame, way, [quaternion_of(pose[:3, :3]) for pose in poses])
        # The box is offset along the x axis of the frame, the tool axis, so that it does not
        # hide the hand.
        server.scene.add_box(
            "/object/box",
            dimensions=(0.09, 0.07, 0.07),
            position=(0.085, 0, 0),
            color=_OBJECT_COLOUR,
        )
        if len(way) > 1 and float(np.ptp(way, axis=0).max()) > 1e-3:
            points = np.stack([way[:-1], way[1:]], axis=1).astype(np.float32)
            server.scene.add_line_segments(
                "/object_path", points, colors=_PATH_COLOUR, thickness=2.0, thickness_units="screen"
            )

    def show(self, frame: int, recording: Any = None) -> None:
        """Move the object to a frame."""
        self._track.show(frame, recording)


class _Force:
    """The force of the object on the hands, as an arrow at the contact."""

    def __init__(
        self, server: viser.ViserServer, poses: NDArray[np.float64], forces: NDArray[np.float64]
    ) -> None:
        begins = poses[:, :3, 3]
        self._points = coarse(np.stack([begins, begins + _FORCE * forces[:, :3]], axis=1))
        self._arrow = server.scene.add_arrows(
            "/force",
            self._points[:1],
            colors=_FORCE_COLOUR,
            shaft_radius=0.006,
            head_radius=0.016,
            head_length=0.035,
        )

    def show(self, frame: int, recording: Any = None) -> None:
        """Draw the force of a frame."""
        self._arrow.points = self._points[frame : frame + 1].astype(np.float32)
