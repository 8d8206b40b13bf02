"""The contact sheet: what was found is marked where it is, in images and in a volume's two views."""

import numpy as np
import pytest

from sonocal import InputError
from sonocal.detection import Detections
from sonocal.files.png import png
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.sweep.contact_sheet import CHOSEN, COLUMNS, FIRST, OTHER, TILE_PX, contact_sheet
from sonocal.sweep.glyphs import written
from tests.builders.sweeps import recording_of_images

IMAGES = recording_of_images(np.full((5, 160, 320), 90, np.uint8))
VOLUMES = recording_of_images(np.full((2, 40, 40, 40), 90, np.uint8), 3)
SEGMENT = np.array([[5.0, 10.0, 30.0], [30.0, 10.0, 8.0]])


LEGEND_ROWS = len(written("0"))


def images_of(*what, **how):
    """The sheet without the words below."""
    return contact_sheet(*what, **how)[:-LEGEND_ROWS]


def rows_of(detections):
    """The rows of a calibration that chose these."""
    each = detections.points_each
    segment = np.array([[0.0, 0, 0], [0, 0, 1]])
    return Observations(
        points_px=detections.points_px.reshape(-1, detections.dimension),
        segments_mm=np.tile(segment, (len(detections) * each, 1, 1)),
        frame=np.repeat(detections.frame, each),
    )


def where(sheet, colour):
    """(rows, columns) of a colour."""
    return np.nonzero((sheet == colour).all(axis=2))


def tile(sheet, index, height, width=TILE_PX):
    row, column = divmod(index, COLUMNS)
    return sheet[row * height : (row + 1) * height, column * width : (column + 1) * width]


def test_the_best_the_others_and_the_chosen_have_their_colours_and_places():
    places = np.array([[100.0, 50.0], [200.0, 80.0], [40.0, 120.0]])
    found = Detections.of_points([1, 1, 1], places)
    sheet = images_of(IMAGES, found, rows_of(found.select([2])))
    assert sheet.shape == (2 * 160, COLUMNS * TILE_PX, 3)
    here = tile(sheet, 1, 160)
    for colour, (u, v) in zip((FIRST, OTHER, CHOSEN), places, strict=True):
        rows, columns = where(here, colour)
        assert (np.round(rows.mean()), np.round(columns.mean())) == (v, u)
        assert len(rows) == len(where(sheet, colour)[0])  # in no other tile
        assert (here[int(v), int(u)] == 90).all()  # what is marked stays visible


def test_the_words_below_bear_the_colours_that_they_name():
    below = contact_sheet(IMAGES, Detections.of_points([0], [[50.0, 50.0]]))[-LEGEND_ROWS:]
    starts = [where(below, colour)[1].min() for colour in (CHOSEN, FIRST, OTHER)]
    assert starts == sorted(set(starts))


def test_of_two_that_meet_the_better_and_the_chosen_are_on_top():
    found = Detections.of_points([0, 0], [[50.0, 50.0], [50.2, 50.0]])
    sheet = images_of(IMAGES, found)
    assert len(where(sheet, FIRST)[0]) > 0
    assert len(where(sheet, OTHER)[0]) == 0
    sheet = images_of(IMAGES, found, rows_of(found.select([1])))
    assert len(where(sheet, CHOSEN)[0]) > 0
    assert len(where(sheet, FIRST)[0]) == 0


def test_without_detections_the_images_are_grey():
    sheet = images_of(IMAGES, Detections.of_points([], np.empty((0, 2))))
    assert (sheet[..., 0] == sheet[..., 2]).all()
    assert (tile(sheet, 5, 160) == 0).all()


@pytest.mark.parametrize("tiles", [1, 2, 5, 12])
def test_so_many_images_are_shown_from_the_first_to_the_last(tiles):
    grey = np.arange(1, 8, dtype=np.uint8)[:, None, None] * np.full((1, 80, 80), 30, np.uint8)
    sheet = images_of(recording_of_images(grey), Detections.of_points([], np.empty((0, 2))), tiles=tiles)
    shown = [
        int(tile(sheet, i, sheet.shape[0] // -(-min(tiles, 7) // COLUMNS))[5, 5, 0])
        for i in range(min(tiles, 7))
    ]
    assert shown == sorted(set(shown))
    assert shown[0] == 30
    assert tiles == 1 or shown[-1] == 210


def test_a_volume_s_line_is_dotted_in_both_of_its_views():
    found = Detections([0], SEGMENT[None])
    plain = images_of(VOLUMES, found.select([]))
    sheet = images_of(VOLUMES, found)
    assert sheet.shape == plain.shape == (TILE_PX // 2, COLUMNS * TILE_PX, 3)
    front, side = np.split(tile(sheet, 0, TILE_PX // 2), 2, axis=1)
    scale = TILE_PX / 2 / 40
    for view, axis in ((front, 0), (side, 2)):
        rows, columns = where(view, FIRST)
        assert set(np.unique(rows)) == {round(10 * scale)}
        ends = np.sort(SEGMENT[:, axis]) * scale
        np.testing.assert_allclose([columns.min(), columns.max()], ends, atol=1)
    assert (tile(sheet, 1, TILE_PX // 2) == tile(plain, 1, TILE_PX // 2)).all()
    chosen = images_of(VOLUMES, found, rows_of(found))
    assert len(where(chosen, CHOSEN)[0]) == len(where(sheet, FIRST)[0])
    assert len(where(chosen, FIRST)[0]) == 0


def test_the_brightest_voxels_along_each_way_are_shown():
    volume = np.full((1, 40, 40, 40), 20, np.uint8)
    volume[0, 7, 12, 30] = 200  # w, v, u
    sheet = images_of(recording_of_images(volume, 3), Detections([0], SEGMENT[None]).select([]))
    front, side = np.split(tile(sheet, 0, TILE_PX // 2), 2, axis=1)
    for view, u in ((front, 30), (side, 7)):
        rows, columns = np.nonzero(view[..., 0] == 200)
        assert set(rows // 4) == {12}
        assert set(columns // 4) == {u}


def test_it_is_a_png_of_its_size():
    sheet = images_of(IMAGES, Detections.of_points([0], [[9, 9]]))
    data = png(sheet)
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    assert (int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")) == sheet.shape[1::-1]


def test_marks_beyond_an_image_are_cut_off():
    found = Detections.of_points([0, 0], [[-2.0, 5.0], [900.0, 5.0]])
    assert images_of(IMAGES, found).shape == (320, COLUMNS * TILE_PX, 3)


def test_where_there_are_no_images_there_is_no_sheet():
    with pytest.raises(InputError, match="recording: has no images to show"):
        images_of(Recording(times=np.arange(2.0)), Detections.of_points([0], [[1, 2]]))


def test_every_image_bears_its_own_number():
    grey = np.zeros((13, 200, 300), dtype=np.uint8)
    sheet = images_of(recording_of_images(grey), Detections.of_points([], np.empty((0, 2))), tiles=13)
    height = sheet.shape[0] // 4
    corners = [tile(sheet, i, height)[-20:-1, :40] for i in range(13)]
    assert len({corner.tobytes() for corner in corners}) == 13
    ones = corners[11][..., 0] // 255
    assert ones[:, :8].sum() == ones[:, 8:16].sum() > 0  # 11: one digit twice


def test_points_of_several_wires_bear_their_numbers_and_those_of_one_none():
    places = np.array([[100.0, 50.0], [200.0, 90.0], [318.0, 158.0]])
    segments = np.tile([[0.0, 0, 0], [0, 0, 1]], (3, 1, 1))
    nothing = Detections.of_points([], np.empty((0, 2)))
    inked = []
    for names, frame in ((["b", "a", "c"], [0, 0, 0]), (["a", "a", "a"], [0, 1, 2])):
        chosen = Observations(
            points_px=places, segments_mm=segments, frame=np.array(frame), target=np.array(names)
        )
        sheet = images_of(IMAGES, nothing, chosen)
        inked.append({(int(v), int(u)) for v, u in zip(*where(sheet, CHOSEN), strict=True)})
    several, one = inked
    assert any(50 < v < 70 and 104 < u < 120 for v, u in several)
    assert any(140 < v < 155 and 304 < u < 314 for v, u in several)  # left above, where it is not cut off
    assert not any(50 < v < 70 and 104 < u < 120 for v, u in one if (v, u) not in {(50, 108)})
    first = {(v - 50, u - 100) for v, u in several if v < 80}
    second = {(v - 90, u - 200) for v, u in several if 80 < v < 120 and u > 190}
    assert first != second
