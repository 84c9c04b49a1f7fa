"""The oracle of damaged files: equal, a warning, or a refusal by name; the full run is benchmarks/log_damage.py."""

from collections import Counter

import pytest

from benchmarks import log_damage
from benchmarks.damage_corpus import READERS

# no byte of these can be wrong unseen: the format holds checksums, or we add them
SEALED = ("parquet_ours", "mat_ours", "mf4_zip", "xlsx", "zipped_csv")
NEEDS = {"mf4": "asammdf", "mf4_zip": "asammdf", "tdms": "nptdms", "mat_v7.3": "matio", "xlsx": "openpyxl"}
# of a thousand; a number that is wrong by less than the signal moves cannot be told where the format has no checksum
MOST_SILENT = {"csv": 5, "csv_comma": 5, "controldesk": 5, "mf4": 25}
OTHERS = 40


def counts(reader, number):
    if reader in NEEDS:
        pytest.importorskip(NEEDS[reader], reason="an extra is not installed")
    return Counter(trial.outcome for trial in log_damage.trials(reader, number))


@pytest.mark.parametrize("reader", READERS)
def test_a_sample_of_damaged_files(reader):
    found = counts(reader, 12)
    assert found["crash"] == 0
    assert found["silent"] <= (0 if reader in SEALED else 2)
    assert found["small"] == 0 or reader not in SEALED


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
def test_a_thousand_damaged_files(reader):
    found = counts(reader, 1000)
    assert found["crash"] == 0
    assert found["silent"] <= (0 if reader in SEALED else MOST_SILENT.get(reader, OTHERS))


def test_the_oracle_tells_silence_from_warning(tmp_path):
    """An oracle that cannot fail proves nothing: a change of 2 bar that no check sees, one of 80 bar that one does."""
    sound = log_damage.whole("csv", tmp_path)
    text = sound.content.decode()
    line = text.splitlines()[400]
    time, u, spool, pressure, rest = line.split(",", 4)

    def outcome(by):
        other = ",".join([time, u, spool, f"{float(pressure) + by:.6f}", rest])
        return log_damage.judge(sound, text.replace(line, other).encode(), tmp_path).outcome

    assert (outcome(0.2), outcome(0.7), outcome(-80.0)) == ("small", "silent", "warned")
    assert log_damage.judge(sound, sound.content.replace(b"p_a", b"p_b"), tmp_path).outcome == "refused"
