"""Store of results: complete parts only, resumable, one writer, the same table in any order."""

import errno
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from armgate.campaign.errors import CampaignError, UsageError
from armgate.campaign.result import Result
from armgate.campaign.store import MANIFEST, PARTS, Store, differences, read_results
from armgate.campaign.table import from_parquet, result_of, to_parquet
from armgate.campaign.trials import Trial

MANIFEST_1 = {"campaign": {"seeds": 3, "name": "a"}, "versions": {"armgate": "1"}}
TRIALS = [
    Trial(f"{7919 * k % 1000:016x}", "s", "c", k, (("cell.a", 0.1 * k), ("cell.b", "x"), ("cell.c", (1, 2))))
    for k in range(60)
]
RESULTS = [
    Result(trial.key, "it broke")
    if trial.seed % 7 == 3
    else Result(trial.key, "", {"x": trial.seed / 3, "P.y": -0.0})
    for trial in TRIALS
]


def fill(folder: Path, order: list[int], parts: int = 1) -> bytes:
    """Put the results in some order, in some parts, and return the table."""
    with Store(folder, MANIFEST_1) as store:
        for number, at in enumerate(order):
            store.put(TRIALS[at], RESULTS[at])
            if number % max(1, len(order) // parts) == 0:
                store.flush()
        return store.complete().read_bytes()


def test_rows_return_as_they_were_put(tmp_path: Path) -> None:
    fill(tmp_path, list(range(60)))
    assert read_results(tmp_path) == {result.key: result for result in RESULTS}
    rows = from_parquet(tmp_path / "results.parquet")
    assert [row["key"] for row in rows] == sorted(trial.key for trial in TRIALS)
    row = next(row for row in rows if row["seed"] == 2)
    assert (row["value.cell.a"], row["value.cell.b"], row["value.cell.c"]) == (0.2, "x", "[1,2]")
    assert result_of(row).figures == {"x": 2 / 3, "P.y": -0.0}


def test_the_table_depends_neither_on_order_nor_on_parts(tmp_path: Path) -> None:
    tables = set()
    for number in range(5):
        order = list(range(60))
        random.Random(number).shuffle(order)
        tables.add(fill(tmp_path / str(number), order, parts=1 + 3 * number))
    assert len(tables) == 1


def test_a_store_continues_where_it_ended(tmp_path: Path) -> None:
    whole = fill(tmp_path / "whole", list(range(60)))
    with Store(tmp_path / "cut", MANIFEST_1) as store:
        for at in range(0, 60, 2):
            store.put(TRIALS[at], RESULTS[at])
    with Store(tmp_path / "cut", MANIFEST_1) as store:
        missing = [at for at in range(60) if TRIALS[at].key not in store]
        assert missing == list(range(1, 60, 2))
    assert fill(tmp_path / "cut", missing) == whole
    assert list((tmp_path / "cut" / PARTS).iterdir()) == []
    assert fill(tmp_path / "cut", []) == whole


def test_a_kill_between_table_and_removal_of_parts_loses_nothing(tmp_path: Path) -> None:
    with Store(tmp_path, MANIFEST_1) as store:
        store.put(TRIALS[0], RESULTS[0])
    (part,) = (tmp_path / PARTS).iterdir()
    kept = part.read_bytes()
    table = fill(tmp_path, [1])
    part.write_bytes(kept)
    assert fill(tmp_path, []) == table


def test_files_that_are_not_complete_are_removed(tmp_path: Path) -> None:
    fill(tmp_path, [0])
    for name in (f"{PARTS}/000009.parquet.tmp", "results.parquet.tmp"):
        (tmp_path / name).write_bytes(b"half")
    with Store(tmp_path, MANIFEST_1) as store:
        assert list(store.rows) == [TRIALS[0].key]
    assert list(tmp_path.rglob("*.tmp")) == []


def test_results_without_their_campaign_are_refused(tmp_path: Path) -> None:
    fill(tmp_path, [0])
    (tmp_path / MANIFEST).unlink()
    with pytest.raises(UsageError, match=r"holds results, but no campaign\.json; choose another --out"):
        Store(tmp_path, MANIFEST_1)


def test_other_files_in_the_folder_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    others = [tmp_path / "mine.tmp", tmp_path / "sub" / "results.parquet.tmp"]
    for other in others:
        other.write_text("mine")
    fill(tmp_path, [0])
    assert [other.read_text() for other in others] == ["mine", "mine"]


def test_a_damaged_part_is_one_clear_error(tmp_path: Path) -> None:
    with Store(tmp_path, MANIFEST_1) as store:
        store.put(TRIALS[0], RESULTS[0])
    (part,) = (tmp_path / PARTS).iterdir()
    data = part.read_bytes()
    for damaged in (data[:50], b"", data[:4] + bytes(40) + data[-4:], data[:-8] + bytes(4) + data[-4:]):
        part.write_bytes(damaged)
        with pytest.raises(CampaignError, match=r"000001.parquet: not a table of results: .*; remove"):
            Store(tmp_path, MANIFEST_1)
    part.unlink()
    with Store(tmp_path, MANIFEST_1) as store:  # the lock was released
        assert store.rows == {}


def test_another_campaign_is_refused_with_what_changed(tmp_path: Path) -> None:
    fill(tmp_path, [0])
    changed = {"campaign": {"seeds": 4, "name": "a"}, "versions": {"armgate": "1", "numpy": "2"}}
    with pytest.raises(UsageError) as caught:
        Store(tmp_path, changed)
    assert str(caught.value).splitlines()[1:] == [
        "  campaign.seeds: 3 before, 4 now", '  versions.numpy: absent before, "2" now',
    ]  # fmt: skip
    assert list(differences({"a": [1, 2]}, {"a": [1, 3]})) == ["a: [1, 2] before, [1, 3] now"]


def test_two_writers_are_refused(tmp_path: Path) -> None:
    code = f"""
from pathlib import Path
from armgate.campaign.store import Store
Store(Path({str(tmp_path)!r}), {MANIFEST_1!r})
"""
    with Store(tmp_path, MANIFEST_1):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert f"the process {os.getpid()} runs this campaign" in done.stderr
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- disk ---------------------------------------------------------------------------------------------------


class Disk:
    """Disk that takes a number of bytes, then is full."""

    def __init__(self, left: int) -> None:
        self.left = left

    def write(self, descriptor: int, data: bytes) -> int:
        if self.left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        done = os.write(descriptor, data[: min(self.left, 100)])
        self.left -= done
        return done


def put_all(folder: Path, disk: Disk) -> None:
    with Store(folder, MANIFEST_1, disk.write) as store:
        for trial, result in zip(TRIALS, RESULTS, strict=True):
            store.put(trial, result)
            store.flush()


def test_a_full_disk_is_one_clear_error_and_the_store_continues(tmp_path: Path) -> None:
    whole = fill(tmp_path / "whole", list(range(60)))
    size = len(to_parquet([]))
    for left in (*range(1, 4 * size, size // 3), 10_000):
        folder = tmp_path / str(left)
        disk = Disk(left)
        with pytest.raises(CampaignError, match=r"the disk is full; .* results are stored\. Make space, and"):
            put_all(folder, disk)
        assert list(folder.rglob("*.tmp")) == []
        with Store(folder, MANIFEST_1) as store:
            missing = [at for at in range(60) if TRIALS[at].key not in store]
        assert len(missing) > 0
        assert fill(folder, missing) == whole


def put_and_fail(folder: Path) -> None:
    with Store(folder, MANIFEST_1, Disk(500).write) as store:
        store.put(TRIALS[0], RESULTS[0])
        raise CampaignError("the workers are lost")


def test_an_earlier_error_is_not_hidden_by_the_last_part(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="the workers are lost"):
        put_and_fail(tmp_path)
    assert (tmp_path / MANIFEST).exists()


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CampaignError, match="file/x: cannot be written: Not a directory"):
        Store(tmp_path / "file" / "x", MANIFEST_1)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[" * 100_000])
def test_a_damaged_manifest_is_one_clear_error(tmp_path: Path, content: bytes) -> None:
    fill(tmp_path, [0])
    (tmp_path / MANIFEST).write_bytes(content)
    with pytest.raises(CampaignError, match=r"campaign.json: damaged: .*; choose another --out"):
        Store(tmp_path, MANIFEST_1)


def test_a_part_with_another_name_is_read_and_kept_apart(tmp_path: Path) -> None:
    fill(tmp_path, [0, 1])
    os.rename(tmp_path / "results.parquet", tmp_path / PARTS / "more.parquet")
    with Store(tmp_path, MANIFEST_1) as store:
        assert TRIALS[1].key in store
        store.put(TRIALS[2], RESULTS[2])
    assert len(read_results(tmp_path)) == 3
