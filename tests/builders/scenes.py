"""Scenes of 3D Slicer, as it writes them."""

import gzip
import zipfile
from urllib.parse import quote

import numpy as np


def transform_sequence(name, times, poses, valid=None):
    """The content of a ``.seq.mha`` of one linear transform."""
    lines = [
        "ObjectType = Image",
        "NDims = 3",
        "AnatomicalOrientation = RAI",
        "BinaryData = True",
        "CompressedData = False",
        f"DimSize = 0 0 {len(times)}",
        "ElementSpacing = 1 1 1",
        "Offset = 0 0 0",
        "TransformMatrix = 1 0 0 0 1 0 0 0 1",
        "ElementType = MET_UCHAR",
        "Kinds = domain domain list",
    ]
    for i, (time, pose) in enumerate(zip(times, poses, strict=True)):
        good = "OK" if valid is None or valid[i] else "INVALID"
        lines += [
            f"Seq_Frame{i:04d}_{name}Transform ={' '.join(map(repr, np.ravel(pose).tolist()))} ",
            f"Seq_Frame{i:04d}_{name}TransformStatus = {good}",
            f"Seq_Frame{i:04d}_Timestamp = {time}",
        ]
    return "\n".join([*lines, "ElementDataFile = LOCAL"]).encode()


def image_sequence(times, pixels):
    """The content of a ``.seq.nrrd`` of images of one slice."""
    header = [
        "NRRD0005",
        "type: uint8",
        "dimension: 4",
        "space: left-posterior-superior",
        f"sizes: {pixels.shape[2]} {pixels.shape[1]} 1 {len(pixels)}",
        "space directions: (0.2,0,0) (0,0.2,0) (0,0,1) none",
        "kinds: domain domain domain list",
        'labels: "" "" "" "time"',
        "encoding: gzip",
        "space origin: (0,0,0)",
        "DataNodeClassName:=vtkMRMLScalarVolumeNode",
        "axis 3 index type:=numeric",
        f"axis 3 index values:={' '.join(map(str, times))}",
    ]
    return "\n".join([*header, "", ""]).encode() + gzip.compress(pixels.tobytes(), mtime=0)


def scene_document(names, folder="", constant=()):
    """The ``.mrml`` of sequences in files of these names, and of constant transforms: (name, matrix)."""
    rows = [
        f'<LinearTransform id="vtkMRMLLinearTransformNode{i}" name="{name}" userTags="" '
        f'matrixTransformToParent="{" ".join(f"{x:g}" for x in np.ravel(matrix))}" />'
        for i, (name, matrix) in enumerate(constant)
    ]
    for i, name in enumerate(names):
        kind = "Volume" if name.endswith(".nrrd") else "LinearTransform"
        rows.append(
            f'<{kind}SequenceStorage id="vtkMRML{kind}SequenceStorageNode{i}" fileName="{quote(folder + name)}" />'
        )
        rows.append(f'<Sequence id="vtkMRMLSequenceNode{i}" name="Sequence" indexName="time" />')
    return "\n".join(['<MRML version="Slicer4.4.0" userTags="">', *rows, "</MRML>"])


def write_scene(path, files, document=None):
    """A scene: an archive where the name says so, else a document with its files beside it."""
    if path.suffix == ".mrml":
        path.write_text(document or scene_document(files))
        for name, content in files.items():
            (path.parent / name).write_bytes(content)
        return
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("A scene/A scene.mrml", document or scene_document(files, "Data/"))
        for name, content in files.items():
            archive.writestr(f"A scene/Data/{name}", content)
