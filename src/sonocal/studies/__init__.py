"""The paper's experiments and studies of practice: simulated trials by the thousand, calibrated and measured."""

from sonocal.studies.definition import Answer, Figure, Study, built_in_names, load_study
from sonocal.studies.methods import METHODS
from sonocal.studies.running import Workers, run_study, threads
from sonocal.studies.scene import Scene
from sonocal.studies.store import Store
from sonocal.studies.summary import Row, answer_sentences, errors_of, summarise

__all__ = [
    "METHODS",
    "Answer",
    "Figure",
    "Row",
    "Scene",
    "Store",
    "Study",
    "Workers",
    "answer_sentences",
    "built_in_names",
    "errors_of",
    "load_study",
    "run_study",
    "summarise",
    "threads",
]
