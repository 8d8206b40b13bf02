"""The table of sightings, and its file."""

from sonocal.observations.table import Observations, group_codes, stacked
from sonocal.observations.table_file import (
    observations_csv,
    parse_observations,
    read_observations,
    write_observations,
)

__all__ = [
    "Observations",
    "group_codes",
    "observations_csv",
    "parse_observations",
    "read_observations",
    "stacked",
    "write_observations",
]
