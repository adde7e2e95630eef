"""Page "Your first client": its bytes, and its client against a real daemon."""

import asyncio
import re
import sys
from pathlib import Path

import pytest

from armgate.protocol import encode
from armgate.protocol import messages as m
from support.clients import PATIENCE, Process

PAGE = (Path(__file__).parents[2] / "docs" / "first-client.md").read_text(encoding="utf-8")
HEX = re.compile(r"((?:[0-9a-f]{2} )*[0-9a-f]{2})  +\S.*")


def block(language):
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return found


def test_the_bytes_of_the_hello_are_those_of_the_codec():
    lines = [HEX.fullmatch(line)[1] for line in block("text").splitlines()]
    assert bytes.fromhex("".join(lines)) == encode(m.Hello(versions=(1,), name="first"))
    assert f"{len(bytes.fromhex(''.join(lines)))} bytes" in PAGE


def test_the_texts_of_the_dump_are_those_of_its_bytes():
    for line in block("text").splitlines():
        quoted = re.search(r'a text of (\d+) bytes: "(\w+)"', line)
        if quoted is not None:
            data = bytes.fromhex(HEX.fullmatch(line)[1])[1:]
            assert (len(data), data.decode()) == (int(quoted[1]), quoted[2])


def test_the_six_messages_and_their_answers_are_those_of_the_protocol():
    rows = re.findall(r"^\| `(\w+)`(?:: ([^|]*))? \| (.*?) \|", PAGE, re.MULTILINE)
    assert len(rows) == 6
    for kind, fields, answer in rows:
        model = m.Catalogue.client[kind]
        assert set(re.findall(r"`(\w+)`", fields)) <= set(model.model_fields)
        expected = m.ANSWERS[model].model_fields["type"].default if model in m.ANSWERS else None
        assert answer.startswith(f"`{expected or {'command': 'verdict', 'bye': 'bye'}[kind]}`")


async def test_the_client_of_the_page_moves_a_robot_without_armgate(tmp_path):
    file = tmp_path / "first_client.py"
    file.write_text(block("python"), encoding="utf-8")
    assert set(re.findall(r"^import (\w+)", file.read_text(), re.MULTILINE)) == {"socket", "sys", "msgpack"}
    program, address, *arguments = re.search(r"^python (.*)$", block("sh"), re.MULTILINE)[1].split()
    assert program == file.name
    async with Process.serving("configs/planar.yaml") as daemon, asyncio.timeout(PATIENCE):
        client = await asyncio.create_subprocess_exec(
            sys.executable, str(file), address.replace("7411", str(daemon.port)), *arguments,
            stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        out, err = await client.communicate()
        assert (client.returncode, err) == (0, b"")
        *refused, printed = out.decode().splitlines()
        assert all(line.startswith("refused: based on tick") for line in refused)  # late on a busy machine
        assert f"prints `{printed}`" in PAGE
        daemon.signal()
        assert (await daemon.end())[0] == 0


@pytest.mark.slow
async def test_the_client_of_the_page_reports_an_error_of_the_server(tmp_path):
    file = tmp_path / "first_client.py"
    file.write_text(block("python"), encoding="utf-8")
    async with Process.serving("configs/planar.yaml") as daemon, asyncio.timeout(PATIENCE):
        client = await asyncio.create_subprocess_exec(
            sys.executable, str(file), f"127.0.0.1:{daemon.port}", "X", "0.3", stderr=asyncio.subprocess.PIPE
        )
        _, err = await client.communicate()
    assert client.returncode == 1
    assert err.decode().startswith("unknown_robot: no robot X")
