"""How many poses of a 15 cm needle for 1 mm at 8 cm? Simulated trials answer; the results stay in the folder "study".

More trials make the answer surer: with 1000 it takes some seconds.
"""

from pathlib import Path

from sonocal.studies import answer_sentences, load_study, run_study, summarise, threads

Path("short-needle.toml").write_text("""
name = "short-needle"
title = "A biopsy needle at 8 cm"
question = "How many poses of a 15 cm needle for 1 mm at 8 cm?"
trials = 100
seed = 0
methods = ["sonocal"]

[scene]
dimension = 2
needle_mm = 150
sigma_mm = 0.3
depth_mm = 80

[factors]
needles = [6, 10, 20, 40]

[figure]
form = "curves"
quantities = ["target_mm"]
statistic = "p95"

[answer]
quantity = "target_mm"
goal = 1.0
wanted = "least"
reached = "{x} poses ({value} mm)"
missed = "more than were tried ({value} mm with {x})"
""")
study = load_study("short-needle.toml")
with threads() as workers:
    store = run_study(study, "study", workers)
rows = summarise(store)
for row in rows:
    if (row.method, row.quantity, row.stage) == ("sonocal", "target_mm", "after"):
        print(f"{row.levels['needles']:3.0f} poses: 95 % of calibrations within {row.p95:.2f} mm")
print("answer:", *answer_sentences(study, rows))
