"""The walks of values through the files of the package: they may become shorter, and the figures
here with them.
"""

from collecting import each_of
from count_walks import count_walk, trace_workflow

#: Of today's code, the most that is allowed. Of find_gap with a file for what its results share.
MOST = {
    "read_sweep": {"files": 12, "rooms": 7, "returns": 11},
    "evaluate": {"files": 23, "rooms": 24, "returns": 26},
    "find_gap": {"files": 21, "rooms": 45, "returns": 52},
}


@each_of("name", MOST)
def test_a_value_walks_through_no_more_files_than_it_did(name: str):
    counts = count_walk(trace_workflow(name))
    longer = {what: count for what, count in counts.items() if count > MOST[name][what]}
    assert longer == {}
