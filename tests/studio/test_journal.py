"""What a person did is on the disk before anything else comes of it."""

import json
import random
import threading

import pytest

from sonocal.errors import FormatError, InputError
from sonocal.studio.journal import Journal
from sonocal.studio.marks import Edit, Mark, edited
from tests.builders.studio import heard, running

INPUTS = {"recording": {"input": "a.mha", "sha256": "1"}}


def edits(count):
    return [Edit(str(i), "move", frame=i, target="needle", at_px=(float(i), 2.0)) for i in range(count)]


def read(path):
    kept = Journal(path, INPUTS)
    kept.close()
    return kept.edits


def test_edits_are_read_back_and_one_that_is_sent_twice_counts_once(tmp_path):
    kept = Journal(tmp_path / "j", INPUTS)
    assert [kept.append(edit) for edit in [*edits(3), *edits(3)]] == [True] * 3 + [False] * 3
    kept.close()
    assert read(tmp_path / "j") == edits(3)


def test_a_line_that_a_crash_cut_short_is_left_out_and_the_next_is_whole(tmp_path):
    kept = Journal(tmp_path / "j", INPUTS)
    for edit in edits(3):
        kept.append(edit)
    kept.close()
    whole = (tmp_path / "j").read_bytes()
    third = whole.rindex(b"\n", 0, -1) + 1
    for cut in range(third, len(whole)):
        (tmp_path / "j").write_bytes(whole[:cut])
        again = Journal(tmp_path / "j", INPUTS)
        assert again.edits == edits(2)
        again.append(edits(4)[3])
        again.close()
        assert read(tmp_path / "j") == [*edits(2), edits(4)[3]]


def test_a_journal_of_another_recording_is_refused(tmp_path):
    Journal(tmp_path / "j", {"recording": {"input": "b.mha", "sha256": "3"}}).close()
    kept = Journal(tmp_path / "j", INPUTS)  # one without edits is nobody's
    kept.append(edits(1)[0])
    kept.close()
    with pytest.raises(InputError, match="holds edits of another recording or other targets"):
        Journal(tmp_path / "j", {"recording": {"input": "a.mha", "sha256": "2"}})
    (tmp_path / "other").write_text("frame,u_px\n1,2\n")
    with pytest.raises(FormatError, match="is no journal"):
        Journal(tmp_path / "other", INPUTS)


def test_undo_leads_back_to_the_start_whatever_was_done():
    rng = random.Random(3)
    found = {(i, "needle"): Mark(((1.0, float(i)),)) for i in range(5)}
    done = []
    for i in range(60):
        action = rng.choice(["move", "drop", "keep", "undo"])
        done.append(Edit(str(i), action, frame=rng.randrange(7), target="needle", at_px=(3.0, float(i))))
        if action != "undo":
            before = edited(found, done[:-1])
            assert edited(found, [*done, Edit(f"u{i}", "undo")]) == before
    undone = [*done, *(Edit(f"z{i}", "undo") for i in range(60))]
    assert edited(found, undone) == found


def test_kills_at_random_moments_lose_no_click_that_was_told_to_be_kept(sweep, tmp_path):
    source, lines = sweep
    rng, told, sent = random.Random(11), set(), 0
    for _ in range(4):
        with running(tmp_path / "studio", source, "--lines", lines) as one:
            one.cookie()
            with one.events() as socket:
                heard(socket, "marks")
                timer = threading.Timer(rng.uniform(0.05, 0.4), one.kill)
                timer.start()
                try:
                    while True:
                        sent += 1
                        frame = rng.randrange(48)
                        edit = {"action": "move", "frame": frame, "target": "needle", "at_px": [9.0, 9.0]}
                        socket.send(json.dumps({"id": f"c{sent}", **edit}))
                        told.add(heard(socket, "kept", within=10)["id"])
                except Exception:
                    timer.join()
    lines_kept = (tmp_path / "studio" / "session.jsonl").read_bytes().split(b"\n")[1:-1]
    kept = [json.loads(line)["id"] for line in lines_kept]
    assert len(told) >= 4
    assert told <= set(kept)
    assert len(kept) == len(set(kept))
