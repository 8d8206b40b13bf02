"""Which matrix of a file is from the image to the probe, and which way it goes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sonocal.errors import InputError
from sonocal.existing.matrix import Existing, Form, Matrices, Stored, affine_inverse, in_form
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["AS", "Choice", "candidates", "chosen", "frames_in", "frames_of", "image_matrices"]

# PLUS gives px of the transducer's origin a frame of their own: it is no place in mm.
PIXELS = re.compile("pixel|transducerorigin", re.IGNORECASE)
IMAGE = re.compile("image", re.IGNORECASE)
# Of a scale: what scales nothing was mostly saved by 3D Slicer, where images have a spacing of their own.
RIGID = 1e-3
OTHER_FORM: dict[Form, Form] = {"direct": "slicer", "slicer": "direct", "inverse": "direct"}
AS: dict[Form, str] = {
    "direct": "as it maps px to mm",
    "inverse": "as the inverse of what maps px to mm",
    "slicer": "as 3D Slicer stores transforms, which is the inverse in LPS axes",
}


@dataclass(frozen=True)
class Choice:
    """What a user says of a file of other software.

    Attributes:
        transform: the name of the matrix, where there are several: ``ImageToProbe``; of NumPy's archives the array's.
        stored_as: how it is stored, where what is in the file does not tell or tells wrong.
    """

    transform: str | None = None
    stored_as: Form | None = None

    __repr__ = brief


def chosen(matrices: Matrices, choice: Choice | None = None) -> Existing:
    """The one matrix that maps the image's px to mm in the probe marker's frame.

    Raises:
        InputError: there is none, or there are several and none was chosen; the sentence lists them.
    """
    choice = choice or Choice()
    stored = _named(matrices, choice.transform) if choice.transform else _only(matrices)
    form = choice.stored_as or stored.form or _form_by_name(stored) or "direct"
    notes = []
    if choice.stored_as is None and stored.form is None and stored.by_scale:
        form = "slicer" if _scale(stored.matrix) > 1.0 - RIGID else "direct"
        notes.append(_by_scale(matrices.file, stored, form))
    if stored.transposed:
        notes.append(_transposed(matrices.file))
    return Existing(
        file=matrices.file,
        format=matrices.format,
        transform=_from_image(stored, form),
        matrix=in_form(stored.matrix, form),
        notes=tuple(notes),
        stated_error_mm=stored.stated_error_mm,
        date=stored.date,
        form=form,
    )


def candidates(matrices: Matrices) -> list[Existing]:
    """All that may be the calibration: of a file whose matrices have names of frames, those from an image."""
    named = [one for one in matrices if frames_of(one) is not None]
    stored = image_matrices(matrices) if named else list(matrices)
    if not stored and (chain := _chained(matrices, "Image", "Probe")) is not None:
        stored = [chain]
    return [chosen(replace(matrices, stored=(one,)), Choice(one.name or None)) for one in stored]


def frames_of(stored: Stored) -> tuple[str, str] | None:
    """Source and target of a transform, as its file or its name says them; None where neither does."""
    return stored.frames or frames_in(stored.name)


def frames_in(name: str) -> tuple[str, str] | None:
    """Source and target of a transform by its name: ``ImageToProbe``, ``probe_from_image``; None of other names."""
    if match := re.fullmatch(r"(.+?)To([A-Z0-9].*)", name):
        return match[1], match[2]
    if match := re.fullmatch(r"(\w+?)_to_(\w+)", name):
        return match[1], match[2]
    if match := re.fullmatch(r"(\w+?)_from_(\w+)", name):
        return match[2], match[1]
    return None


def image_matrices(matrices: Matrices) -> list[Stored]:
    """Those that lead from an image to a place in mm, or back, by their names."""
    found = []
    for one in matrices:
        frames = frames_of(one)
        if frames is not None and sum(_is_image(frame) for frame in frames) == 1:
            other = next(frame for frame in frames if not _is_image(frame))
            found += [] if PIXELS.search(other) else [one]
    return found


def _is_image(frame: str) -> bool:
    return IMAGE.search(frame) is not None and PIXELS.search(frame) is None


def _only(matrices: Matrices) -> Stored:
    """The matrix to take where none was named."""
    if len(matrices.stored) == 1 and frames_of(matrices.stored[0]) is None:
        return matrices.stored[0]
    found = image_matrices(matrices)
    if not found and (chain := _chained(matrices, "Image", "Probe")) is not None:
        return chain
    unnamed = [one for one in matrices if frames_of(one) is None]
    if not found and len(unnamed) == 1:
        return unnamed[0]
    if len(found) == 1:
        return found[0]
    if not found and not unnamed:
        raise InputError(
            f"{matrices.file}: has no transform from an image to a marker, such as ImageToProbe; it has "
            f"{matrices.names[:300] or 'none'}"
        )
    named = ", ".join(one.name for one in (found or unnamed))[:300]
    raise InputError(
        f"{matrices.file}: has several matrices that may be the calibration: {named}; name one with --transform"
    )


def _named(matrices: Matrices, name: str) -> Stored:
    """The matrix of a name, or through the others, where the name is of two frames that they connect."""
    for one in matrices:
        if one.name.lower() == name.lower():
            return one
    frames = frames_in(name)
    if frames is not None and (chain := _chained(matrices, *frames)) is not None:
        return chain
    raise InputError(
        f"{matrices.file}: has no transform {name[:60]}, and no others lead there; it has {matrices.names[:300]}"
    )


def _chained(matrices: Matrices, source: str, target: str) -> Stored | None:
    """The product of transforms that lead from one frame to another; None where none do."""
    edges: dict[str, dict[str, Array]] = {}
    known = {}
    for one in matrices:
        if (frames := frames_of(one)) is not None:
            start, end = (frame.lower() for frame in frames)
            known[start, end] = one
            edges.setdefault(start, {})[end] = one.matrix
            edges.setdefault(end, {}).setdefault(start, affine_inverse(one.matrix))
    goal, reached = target.lower(), {source.lower(): np.eye(4)}
    _spread(edges, reached)
    if goal not in reached or goal == source.lower():
        return None
    name = f"{source}To{target}"
    if (back := known.get((goal, source.lower()))) is not None:
        return replace(back, name=name, matrix=reached[goal], form="direct")
    return Stored(name, reached[goal], form="direct")


def _spread(edges: Mapping[str, Mapping[str, Array]], reached: dict[str, Array]) -> None:
    """Adds every frame that is connected to those reached, with the way to it."""
    ahead = list(reached)
    while ahead:
        here = ahead.pop(0)
        for there, matrix in edges.get(here, {}).items():
            if there not in reached:
                reached[there] = np.asarray(matrix @ reached[here])
                ahead.append(there)


def _form_by_name(stored: Stored) -> Form | None:
    return "inverse" if _leads_to_image(stored) else None


def _from_image(stored: Stored, form: Form) -> str:
    """What a matrix is called once it was read, which is from px to mm, whatever its file calls it.

    A name without an image in it says nothing but that the inverse goes the other way.
    """
    frames = frames_of(stored)
    if frames is None or (_is_image(frames[0]) and not _is_image(frames[1])):
        return stored.name
    turned = _leads_to_image(stored) or form == "inverse"
    return _turned(stored.name, *frames) if turned else stored.name


def _leads_to_image(stored: Stored) -> bool:
    frames = frames_of(stored)
    return frames is not None and not _is_image(frames[0]) and _is_image(frames[1])


def _turned(name: str, source: str, target: str) -> str:
    """What the inverse of a transform is called, in the same way of speaking."""
    if "_from_" in name:
        return f"{source}_from_{target}"
    return f"{target}_to_{source}" if "_to_" in name else f"{target}To{source}"


def _scale(matrix: Array) -> float:
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def _by_scale(file: str, stored: Stored, form: Form) -> Diagnostic:
    scale = _scale(stored.matrix)
    here, otherwise = (1 / scale, scale) if form == "slicer" else (scale, 1 / scale)
    return Diagnostic(
        code="direction-by-scale",
        severity="info",
        message=(
            f"the matrix of {file} was read {AS[form]}, with {here:.4g} mm/px, since the file does not say which way "
            f"it goes; read {AS[OTHER_FORM[form]]}, it would have {otherwise:.4g}"
        ),
        advice=f"if it is the other, give --stored-as {OTHER_FORM[form]}",
    )


def _transposed(file: str) -> Diagnostic:
    return Diagnostic(
        code="transposed-matrix",
        severity="warning",
        message=(
            f"the matrix of {file} is transposed: its translation stands in the last row, and its last column is "
            "0 0 0 1; it was turned back"
        ),
        advice="mind it in other software: points are columns there, and the translation is the last column",
    )
