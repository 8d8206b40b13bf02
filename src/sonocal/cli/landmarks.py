"""The part of ``sonocal tool`` that puts a phantom in place: landmarks touched, lines and planes dragged along."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from sonocal.cli.options import console
from sonocal.cli.outputs import reserve
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.told import refuse_units
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.recording import Recording
    from sonocal.targets import Line, Plane, Point, Target
    from sonocal.tools import PhantomRegistration, Stylus

__all__ = ["OF_LANDMARKS", "place_phantom"]

# Options that mean something with --landmarks alone, and those that mean nothing with it.
OF_LANDMARKS = ("into", "in_order", "dragged")
OF_TOOLS = ("spin", "second", "spin_frames", "second_frames", "length_mm", "expected")


class _Phantom(NamedTuple):
    landmarks: tuple[Point, ...]
    targets: tuple[Target, ...]
    reference: str


def place_phantom(
    recording: Recording, phantom: Path, output: Path | None, options: dict[str, Any], *, as_json: bool
) -> None:
    """Register a phantom by its landmarks, show it, and write it.

    Args:
        recording: of the stylus.
        phantom: a device set or a file of targets: the landmarks, and the wires.
        output: a device set (.xml) or targets (.toml); nothing is written if None.
        options: of the command.
        as_json: print for programs.
    """
    from sonocal.cli.screen.landmarks import print_phantom
    from sonocal.files import write_atomically

    _refuse_others(options)
    into = options["into"] or (phantom if phantom.suffix.lower() == ".xml" else None)
    _check_output(output, into)
    read = _read(phantom, dragged=bool(options["dragged"]))
    found = _registered(recording, read, _stylus(phantom, options), phantom.name, options)
    refuse_units(recording.name, found.diagnostics, accepted=options["accept_units"])
    if output is not None:
        content = (
            _device_set(found, into) if output.suffix.lower() == ".xml" else _targets(found, read, output)
        )
        reserve(output)
        write_atomically(output, content)
    if as_json:
        say_json(found)
        return
    print_phantom(console(), found)
    if output is not None:
        say(f"Wrote {output}")


def _registered(
    recording: Recording, read: _Phantom, stylus: Stylus, name: str, options: dict[str, Any]
) -> PhantomRegistration:
    from sonocal.tools import register_features, register_landmarks

    how = {
        "reference": options["reference"] or _tracked(recording, read.reference),
        "targets": read.targets,
        "in_order": options["in_order"],
        "on_invalid": options["on_invalid"],
    }
    if not options["dragged"]:
        return register_landmarks(recording, read.landmarks, stylus, seed=options["seed"], **how)
    return register_features(
        recording, read.landmarks, _dragged(read, name, options["dragged"]), stylus, **how
    )


def _dragged(read: _Phantom, name: str, names: tuple[str, ...]) -> list[Line | Plane]:
    """The lines and planes of those names, in the order named; all of them if that is "all"."""
    from sonocal.targets import Line, Plane

    have = {one.name: one for one in read.targets if isinstance(one, (Line, Plane))}
    if names == ("all",):
        return list(have.values())
    if missing := [one for one in names if one not in have]:
        raise InputError(
            f"{name}: has no line or plane {missing[0]!r} to drag along; it has {', '.join(have)[:200] or 'none'}"
        )
    return [have[one] for one in names]


def _refuse_others(options: dict[str, Any]) -> None:
    for name in OF_TOOLS:
        if options.get(name) is not None:
            option = name.removesuffix("_mm").replace("_", "-")
            raise click.UsageError(
                f"--{option} is for tools, and --landmarks registers a phantom; leave one out"
            )


def _check_output(output: Path | None, into: Path | None) -> None:
    if output is None:
        return
    if output.suffix.lower() not in (".xml", ".toml"):
        raise InputError(
            f"{output}: a phantom's place is written as .xml or .toml; choose one of these names"
        )
    if output.suffix.lower() == ".xml" and into is None:
        raise InputError(f"{output}: needs a device set to stand in; give it with --into, or write a .toml")
    reserve(output)


def _read(path: Path, *, dragged: bool) -> _Phantom:
    from sonocal.cli.formats import kind_of, require_kind
    from sonocal.targets import in_phantom, read_device_set, read_targets

    require_kind(path, ("device set", "targets"))
    if kind_of(path) == "device set":
        devices = read_device_set(path)
        if not devices.landmarks and not dragged:
            raise InputError(
                f"{path.name}: its phantom has no landmarks; give each a <Landmark Name=... Position=...> in "
                "<PhantomDefinition><Geometry><Landmarks>"
            )
        return _Phantom(devices.landmarks, devices.wires, devices.reference)
    targets = in_phantom(read_targets(path))
    if not targets.points and not dragged:
        raise InputError(
            f"{path.name}: has no landmarks; write each as a [[point]] with name, frame and at_mm"
        )
    everything: tuple[Target, ...] = (*targets.lines, *targets.planes)
    frame = (*targets.points, *everything)[0].frame if targets.points or everything else "Phantom"
    other = next((one for one in targets.points if one.frame != frame), None)
    if other is not None:
        raise InputError(
            f"{path.name}: its landmarks are in the frames {frame} and {other.frame} ({other.name}); a phantom has one"
        )
    own = [one for one in everything if one.frame == frame]
    return _Phantom(targets.points, tuple(own), "")


def _stylus(phantom: Path, options: dict[str, Any]) -> Stylus:
    """The stylus with its tip, which the phantom's device set may hold."""
    from sonocal.cli.formats import kind_of
    from sonocal.cli.tips import place_of_tip
    from sonocal.tools import Stylus

    name, tip = options["stylus"] or "Stylus", options["stylus_tip"]
    if tip is None and kind_of(phantom) != "device set":
        raise InputError(
            f"{phantom.name}: says nothing of the tip of {name}; give it with --stylus-tip, as X,Y,Z in mm or the file "
            "that sonocal tool wrote when the stylus was pivoted"
        )
    return Stylus(name, place_of_tip(phantom if tip is None else tip, name))


def _tracked(recording: Recording, frame: str) -> str | None:
    """A device set's reference, where the recording knows it."""
    frames = {name.lower() for poses in recording.poses.values() for name in (poses.source, poses.target)}
    return frame if frame.lower() in frames else None


def _device_set(found: PhantomRegistration, into: Path | None) -> bytes:
    from sonocal.files.xml import read_xml
    from sonocal.targets.device_set_edit import put_transform, transform_values

    assert into is not None, "checked before"
    comment = (
        f" {found.phantom}To{found.reference} was registered by {_by(found)}, {found.rms_mm:.3f} mm rms. "
    )
    values = transform_values(found.reference_from_phantom, found.mean_mm)
    return put_transform(read_xml(into), into.name, (found.phantom, found.reference), values, comment)


def _by(found: PhantomRegistration) -> str:
    along = sum(one.used for one in found.features)
    touched = f"{sum(one.used for one in found.landmarks)} landmarks"
    return touched if not found.features else f"{touched}, {along} lines and planes"


def _targets(found: PhantomRegistration, read: _Phantom, output: Path) -> bytes:
    """The phantom's wires and planes, or its landmarks where it has none, in the frame that it is registered in."""
    import numpy as np

    from sonocal.targets import Line, Plane, Point, lines_toml

    motion = found.reference_from_phantom

    def there(places: Any) -> Any:
        return np.asarray(places) @ motion[:3, :3].T + motion[:3, 3]

    lines = [Line(x.name, found.reference, there(x.segment_mm)) for x in read.targets if isinstance(x, Line)]
    planes = [
        Plane(x.name, found.reference, there(x.points_mm)) for x in read.targets if isinstance(x, Plane)
    ]
    points = [Point(x.name, found.reference, there(x.place_mm)) for x in read.landmarks if not read.targets]
    remark = f"{found.phantom} in the frame {found.reference}, by {_by(found)}"
    return lines_toml(str(output), lines, points, [remark, f"{found.rms_mm:.3f} mm rms"], planes=planes)
