"""``armgate audit``: the hash chain of a recording and its signature, from the daemon to the command."""

import subprocess

import pytest
import yaml

from armgate.daemon.recording.recorder import Recorder
from armgate.recorder.signer import load_signer
from armgate.recording import Recording, part_name
from armgate.recording.scan import scan
from support import records
from support.cells import arms_yaml
from support.clients import Mover, Process, run


def keys(folder, name):
    """Make a private and a public key as documented."""
    private, public = folder / f"{name}.key", folder / f"{name}.pub"
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", private], check=True)
    subprocess.run(["openssl", "pkey", "-in", private, "-pubout", "-out", public], check=True)
    private.chmod(0o600)
    return private, public


async def recorded(folder, **recording):
    """Record a run in which a robot moves; return its folder and the daemon's log."""
    file, out = folder / "arms.yaml", folder / "run"
    text = arms_yaml(max_age_ticks=1000)
    file.write_text(text + yaml.safe_dump({"recording": recording}) if recording else text)
    async with Process.serving(file, "--record", out) as daemon:
        mover = await Mover.start(daemon.port, "A")
        await mover.moves_on(20)
        await mover.stop()
        daemon.signal()
        status, log = await daemon.end()
    assert status == 0
    return out, log


@pytest.mark.slow
async def test_the_log_contains_the_seal_of_a_run(tmp_path):
    out, log = await recorded(tmp_path)
    (closed,) = [line for line in log if line["event"] == "recording.closed"]
    status, text, err = await run("audit", out)
    assert (status, err) == (0, "")
    assert "hash chain intact" in text
    assert f"sealed {closed['sha256']}" in text
    status, text, _ = await run("replay", out)
    assert (status, "hash chain intact" in text) == (0, True)


@pytest.mark.slow
async def test_audit_and_replay_report_a_changed_run(tmp_path):
    out, _ = await recorded(tmp_path)
    file = out / part_name(1)
    place, data = scan(file).chunks[3], bytearray(file.read_bytes())
    data[place.end + 9] ^= 1  # in an index: no message changes
    file.write_bytes(data)
    for command in ("audit", "replay"):
        status, text, _ = await run(command, out)
        assert status == 1
        assert "hash chain broken" in text
        assert f"bytes {place.begin} to" in text
    status, _, _ = await run("report", out)
    assert status == 0
    assert "broken: " in (out / "report.html").read_text()


@pytest.mark.slow
async def test_a_signature_is_verified_against_the_key(tmp_path):
    private, public = keys(tmp_path, "recorder")
    _, other = keys(tmp_path, "other")
    out, _ = await recorded(tmp_path, sign=str(private))
    status, text, err = await run("audit", out, "--key", public)
    assert (status, err) == (0, "")
    assert "signed with the key" in text
    status, _, err = await run("audit", out, "--key", other)
    assert (status, "signed with another key" in err) == (1, True)
    status, _, err = await run("audit", out, "--key", private)
    assert (status, "expected an Ed25519 public key" in err) == (2, True)
    assert private.read_bytes() not in (out / part_name(1)).read_bytes()


@pytest.mark.slow
async def test_a_removed_or_changed_signature_is_an_error(tmp_path):
    private, public = keys(tmp_path, "recorder")
    out, _ = await recorded(tmp_path, sign=str(private))
    file = out / part_name(1)
    data = file.read_bytes()
    at = data.index(b"signature", scan(file).chunks[-1].end) + len("signature") + 4
    digit = b"0" if data[at : at + 1] != b"0" else b"1"
    file.write_bytes(data[:at] + digit + data[at + 1 :])
    status, _, err = await run("audit", out, "--key", public)
    assert (status, "signature of the recording is wrong" in err) == (1, True)
    plain, _ = await recorded_beside(tmp_path)
    status, _, err = await run("audit", plain, "--key", public)
    assert (status, "is not signed" in err) == (1, True)


@pytest.mark.slow
async def test_a_signed_run_without_its_last_or_first_part_fails(tmp_path):
    private, public = keys(tmp_path, "recorder")
    recorder = Recorder(tmp_path / "run", rotate=20_000, flush=0.0, signer=load_signer(private))
    recorder.begin(records.header(), lambda: 0.5)
    for k in range(400):
        recorder.tap(records.tick_items(k)[0][1].event, ())
    recorder.close()
    *_, last = files = sorted((tmp_path / "run").iterdir())
    status, text, err = await run("audit", tmp_path / "run", "--key", public)
    assert (status, err, f"in parts 1 to {len(files)}, sealed" in text) == (0, "", True)
    last.rename(tmp_path / last.name)
    status, text, _ = await run("audit", tmp_path / "run", "--key", public)
    assert (status, f"part {len(files)} is missing; this part is not the last one" in text) == (1, True)
    (tmp_path / last.name).rename(last)
    files[0].unlink()
    status, text, _ = await run("audit", tmp_path / "run", "--key", public)
    assert (status, "part 1 is missing" in text) == (1, True)


async def test_a_missing_public_key_is_wrong_use(tmp_path):
    missing = tmp_path / "missing.pem"
    status, _, err = await run("audit", tmp_path, "--key", missing)
    assert (status, f"{missing}: No such file or directory; expected an Ed25519" in err) == (2, True)


async def recorded_beside(folder):
    (folder / "plain").mkdir()
    return await recorded(folder / "plain")


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda key: key.chmod(0o644), "chmod 600"),
        (lambda key: key.write_text("no key"), "Ed25519 private key in PEM"),
        (lambda key: key.unlink(), "No such file"),
        (lambda key: key.write_bytes(rsa()), "expected an Ed25519 key"),
    ],
)
async def test_a_key_that_cannot_sign_prevents_the_start(tmp_path, make, text):
    private, _ = keys(tmp_path, "recorder")
    make(private)
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml() + f"recording: {{sign: {private}}}\n")
    status, _, err = await run("serve", file, "--port", "0", "--record", tmp_path / "run")
    assert (status, text in err, "Traceback" in err) == (2, True, False)


def rsa():
    made = ["openssl", "genpkey", "-algorithm", "RSA", "-pkeyopt", "rsa_keygen_bits:2048"]
    return subprocess.run(made, check=True, capture_output=True).stdout


@pytest.mark.slow
async def test_a_recovered_run_has_a_new_chain_without_a_signature(tmp_path):
    private, public = keys(tmp_path, "recorder")
    out, _ = await recorded(tmp_path, sign=str(private))
    file = out / part_name(1)
    file.write_bytes(file.read_bytes()[: scan(file).chunks[-1].begin])
    assert (await run("recover", out))[0] == 0
    assert Recording.open(out).whole
    status, text, _ = await run("audit", out)
    assert (status, "hash chain intact" in text, "by armgate recover" in text) == (0, True, True)
    status, _, err = await run("audit", out, "--key", public)
    assert (status, "is not signed" in err) == (1, True)
