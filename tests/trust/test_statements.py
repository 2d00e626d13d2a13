"""Signed statements on audits, checked by hand-made bytes and by openssl, which share no code with ours."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from gaugeblock.auditing.attest import attest
from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.statement import STATEMENT, statement_differences
from gaugeblock.auditing.verify import verify
from gaugeblock.cli import app
from gaugeblock.core.envelope import PASSPHRASE, public_key
from gaugeblock.core.errors import InputError

serialization = pytest.importorskip("cryptography.hazmat.primitives.serialization")
ed25519 = pytest.importorskip("cryptography.hazmat.primitives.asymmetric.ed25519")
SMALL = {"number": 40, "draws": 20, "importance_number": 0, "joint_number": 0, "seed": 4}
WORD = b"correct horse"


def key_files(folder: Path, name: str, number: int, *, word: bytes | None = None) -> tuple[Path, Path]:
    """A private and a public key in PEM."""
    key = ed25519.Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32)
    locked = serialization.BestAvailableEncryption(word) if word else serialization.NoEncryption()
    private, public = folder / f"{name}.pem", folder / f"{name}.pub.pem"
    private.write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, locked)
    )
    public.write_bytes(
        key.public_key().public_bytes(
            serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
        )
    )
    return private, public


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return key_files(tmp_path_factory.mktemp("keys"), "mine", 7)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory, keys: tuple[Path, Path]) -> Path:
    out = tmp_path_factory.mktemp("signed") / "out"
    simulator = {"name": "linear_gaussian", "parameters": 2, "data": 2}
    audit("exact", simulator, trials=SMALL, out=out, validators=["draws", "sbc"], progress=False)
    assert attest(out, keys[0]) == out / STATEMENT
    return out


@pytest.fixture
def folder(once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(once, tmp_path / "out"))


def parts(folder: Path) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """The envelope, the statement in it, and the bytes that must have been signed."""
    envelope = json.loads((folder / STATEMENT).read_bytes())
    payload = base64.b64decode(envelope["payload"])
    signed = b"DSSEv1 28 application/vnd.in-toto+json " + str(len(payload)).encode() + b" " + payload
    return envelope, json.loads(payload), signed


def seal_anew(
    folder: Path, private: Path, payload: bytes, kind: str = "application/vnd.in-toto+json"
) -> None:
    """An envelope of anything that somebody may sign, made here."""
    key = serialization.load_pem_private_key(private.read_bytes(), None)
    signed = f"DSSEv1 {len(kind)} {kind} {len(payload)} ".encode() + payload
    content = {
        "payload": base64.urlsafe_b64encode(payload).decode(),
        "payloadType": kind,
        "signatures": [{"sig": "AAAA"}, {"sig": base64.urlsafe_b64encode(key.sign(signed)).decode()}],
    }
    (folder / STATEMENT).write_text(json.dumps(content))


def test_what_is_signed_is_what_the_standards_say(folder: Path, keys: tuple[Path, Path]) -> None:
    envelope, statement, signed = parts(folder)
    (signature,) = envelope["signatures"]
    serialization.load_pem_public_key(keys[1].read_bytes()).verify(base64.b64decode(signature["sig"]), signed)
    assert envelope["payloadType"] == "application/vnd.in-toto+json"
    assert statement["_type"] == "https://in-toto.io/Statement/v1"
    verdict = json.loads((folder / "verdict.json").read_text())
    digests = {entry["name"]: entry["digest"]["sha256"] for entry in statement["subject"]}
    files = ("verdict.json", "trials.nc", "findings.nc", "report.html")
    assert digests == {
        **{name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in files},
        "estimator": verdict["provenance"]["sha256"]["estimator"],
    }
    predicate = statement["predicate"]
    assert predicate["outcome"] == verdict["verdict"]
    assert predicate["policy"] == verdict["provenance"]["policy"]
    assert predicate["gates"] == [{"id": gate["id"], "verdict": gate["verdict"]} for gate in verdict["gates"]]
    assert predicate["seed"] == 4
    # One text whatever wrote it: what is signed again is the same file.
    assert signed.endswith(json.dumps(statement, sort_keys=True, separators=(",", ":")).encode())


@pytest.mark.parametrize("locked", [False, True])
def test_openssl_makes_the_key_and_checks_the_signature(
    folder: Path,
    tmp_path: Path,
    locked: bool,
    monkeypatch: pytest.MonkeyPatch,
    missing: Callable[[str], None],
) -> None:
    if not shutil.which("openssl"):
        missing("no openssl found")
    private, public = tmp_path / "key.pem", tmp_path / "public.pem"
    made = ["openssl", "genpkey", "-algorithm", "ed25519", "-out", str(private)]
    word = ["-passin", f"pass:{WORD.decode()}"] if locked else []
    subprocess.run(made + (["-aes256", "-pass", word[1]] if locked else []), check=True, capture_output=True)
    subprocess.run(
        ["openssl", "pkey", "-in", str(private), *word, "-pubout", "-out", str(public)], check=True
    )
    (folder / STATEMENT).unlink()
    # One for other keys does no harm.
    monkeypatch.setenv(PASSPHRASE, WORD.decode())
    attest(folder, private)
    envelope, _, signed = parts(folder)
    (tmp_path / "signed").write_bytes(signed)
    (tmp_path / "sig").write_bytes(base64.b64decode(envelope["signatures"][0]["sig"]))
    check = ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", str(public), "-rawin"]
    check += ["-in", str(tmp_path / "signed"), "-sigfile", str(tmp_path / "sig")]
    assert subprocess.run(check, check=False, capture_output=True).returncode == 0
    (tmp_path / "signed").write_bytes(signed[:-1] + b" ")
    assert subprocess.run(check, check=False, capture_output=True).returncode != 0
    der = subprocess.run(
        ["openssl", "pkey", "-pubin", "-in", str(public), "-outform", "DER"], check=True, capture_output=True
    )
    assert envelope["signatures"][0]["keyid"] == hashlib.sha256(der.stdout).hexdigest()
    assert not verify(folder, signer=public).differences


@pytest.mark.attack(
    "everything made anew around other trials, after somebody signed", "DIFFERENT by --signer"
)
def test_what_is_made_anew_is_not_what_was_signed(folder: Path, keys: tuple[Path, Path]) -> None:
    simulator = {"name": "linear_gaussian", "parameters": 2, "data": 2}
    trials = {**SMALL, "seed": 5}
    audit("exact", simulator, trials=trials, out=folder, validators=["draws", "sbc"], progress=False)
    assert not verify(folder).differences
    lines = verify(folder, signer=keys[1]).differences
    for name in ("verdict.json", "trials.nc", "findings.nc", "report.html"):
        assert sum(f"subject {name} has sha256" in line for line in lines) == 1
    assert f"{STATEMENT}: predicate.seed is 4, should be 5" in lines
    done = CliRunner().invoke(app, ["verify", str(folder), "--signer", str(keys[1])])
    assert done.exit_code == 1
    assert "DIFFERENT" in done.output
    assert "is signed by the key" not in done.output


@pytest.mark.attack("a statement changed, of another key, of another kind, or gone", "DIFFERENT by --signer")
def test_statements_that_do_not_hold(folder: Path, keys: tuple[Path, Path], tmp_path: Path) -> None:
    envelope, statement, _ = parts(folder)
    payload = base64.b64decode(envelope["payload"])
    theirs, their_public = key_files(tmp_path, "theirs", 8)
    found = verify(folder, signer=keys[1])
    assert not found.differences
    assert found.notes[-1].startswith("the statement is signed by the key")

    owner = public_key(keys[1])

    def only_line() -> str:
        """What `verify` says of the statement: the audit itself stays as it is."""
        (line,) = statement_differences(folder, owner)
        return line

    forged = payload.replace(b'"outcome":"', b'"outcome":"X')
    changed = {**envelope, "payload": base64.b64encode(forged).decode()}
    (folder / STATEMENT).write_text(json.dumps(changed))
    found = verify(folder, signer=keys[1])
    assert "is not signed by the key" in only_line()
    assert found.differences == (only_line(),)
    assert not any("is signed by" in note for note in found.notes)
    (folder / STATEMENT).write_text(json.dumps({**envelope, "payloadType": "text/plain"}))
    assert "holds text/plain, not application/vnd.in-toto+json" in only_line()
    # Signed as what it says, by the right key: it is that kind all the same.
    seal_anew(folder, keys[0], payload, kind="text/plain")
    assert "holds text/plain" in only_line()
    for broken in (
        b"",
        b"{",
        b"[]",
        b'{"payload": 1}',
        b"[" * 100_000,
        b'{"payload": "*", "payloadType": ""}',
    ):
        (folder / STATEMENT).write_bytes(broken)
        assert only_line() == f"{STATEMENT}: is no DSSE envelope"
    seal_anew(folder, theirs, payload)
    assert "is not signed by the key" in only_line()
    assert not verify(folder, signer=their_public).differences
    # The other alphabet, and somebody else's signature beside the right one.
    seal_anew(folder, keys[0], payload)
    assert not list(statement_differences(folder, owner))
    for odd in (b"1", b"[]", b'{"subject": 1}', b"\xff", b'{"subject": [{"name": "a"}]}'):
        seal_anew(folder, keys[0], odd)
        assert only_line() == f"{STATEMENT}: is signed, and holds no statement of in-toto"
    fewer = {**statement, "subject": statement["subject"][1:]}
    seal_anew(folder, keys[0], json.dumps(fewer).encode())
    assert only_line() == f"{STATEMENT}: subject verdict.json should not be there"
    other = json.loads(json.dumps(statement).replace("https://in-toto.io/Statement/v1", "v0"))
    seal_anew(folder, keys[0], json.dumps(other).encode())
    assert "_type is 'v0'" in only_line()
    (folder / STATEMENT).unlink()
    assert only_line() == f"{STATEMENT}: is missing: nobody signed this audit"
    (folder / STATEMENT).write_text(json.dumps(envelope))
    (folder / "report.html").unlink()
    assert any(line.startswith(f"{STATEMENT}: {folder / 'report.html'}") for line in
               verify(folder, signer=keys[1]).differences)  # fmt: skip


def test_a_statement_elsewhere(folder: Path, keys: tuple[Path, Path], tmp_path: Path) -> None:
    elsewhere = tmp_path / "said.json"
    (folder / STATEMENT).rename(elsewhere)
    assert not verify(folder, signer=keys[1], statement=elsewhere).differences
    with pytest.raises(InputError, match="cannot be read"):
        verify(folder, signer=keys[1], statement=tmp_path / "none.json")
    with pytest.raises(InputError, match="say whose it should be: --signer"):
        verify(folder, statement=elsewhere)
    moved = tmp_path / "trials-elsewhere.nc"
    (folder / "trials.nc").rename(moved)
    assert not verify(folder, trials=moved, signer=keys[1], statement=elsewhere).differences
    assert attest(folder, keys[0], trials=moved).read_bytes() == elsewhere.read_bytes()


@pytest.mark.attack("a statement in the place of another's; an audit that does not verify, to be signed",
                    "refused, exit 2, nothing written")  # fmt: skip
def test_nothing_is_overwritten_and_nothing_forged_is_signed(
    folder: Path, keys: tuple[Path, Path], tmp_path: Path
) -> None:
    theirs, their_public = key_files(tmp_path, "theirs", 8)
    before = (folder / STATEMENT).read_bytes()
    # The same again is the same.
    assert attest(folder, keys[0]).read_bytes() == before
    with pytest.raises(InputError, match="is another statement, of another key or audit"):
        attest(folder, theirs)
    assert (folder / STATEMENT).read_bytes() == before
    beside = attest(folder, theirs, out=tmp_path / "theirs.json")
    assert not verify(folder, signer=their_public, statement=beside).differences
    (folder / STATEMENT).unlink()
    (folder / "summary.md").write_text("PASS")
    with pytest.raises(InputError, match="nothing is signed that is not what its trials give"):
        attest(folder, keys[0])
    assert not (folder / STATEMENT).exists()
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_keys_that_cannot_be_used(
    folder: Path, keys: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / STATEMENT).unlink()
    locked, _ = key_files(tmp_path, "locked", 7, word=WORD)
    monkeypatch.delenv(PASSPHRASE, raising=False)
    with pytest.raises(
        InputError, match=f"is encrypted; give its passphrase in the environment, as {PASSPHRASE}"
    ):
        attest(folder, locked)
    monkeypatch.setenv(PASSPHRASE, "wrong")
    with pytest.raises(InputError, match="may be wrong"):
        attest(folder, locked)
    monkeypatch.setenv(PASSPHRASE, WORD.decode())
    attest(folder, locked)
    assert not verify(folder, signer=keys[1]).differences
    (tmp_path / "words.pem").write_text("words")
    other = pytest.importorskip("cryptography.hazmat.primitives.asymmetric.x25519")
    stranger = other.X25519PrivateKey.generate()
    (tmp_path / "x.pem").write_bytes(
        stranger.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    (tmp_path / "x.pub.pem").write_bytes(
        stranger.public_key().public_bytes(
            serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
        )
    )
    for name, private, public in (
        ("words.pem", "cannot be read as a private key", "cannot be read as a public key"),
        ("x.pem", "is no Ed25519 key; openssl", "is a private key; give the public one"),
        ("x.pub.pem", "cannot be read as a private key", "is no Ed25519 key"),
        ("none.pem", "cannot be read", "cannot be read"),
    ):
        with pytest.raises(InputError, match=private):
            attest(folder, tmp_path / name)
        with pytest.raises(InputError, match=public):
            verify(folder, signer=tmp_path / name)
    done = CliRunner().invoke(app, ["attest", str(folder), "--key", str(keys[0])])
    assert done.exit_code == 0, done.output
    assert "gaugeblock verify DIR --signer PUBLIC.pem" in done.output
    elsewhere = tmp_path / "mine.json"
    done = CliRunner().invoke(
        app, ["attest", str(folder), "--key", str(keys[0]), "--out", str(elsewhere), "--json"]
    )
    assert json.loads(done.stdout) == {"statement": str(elsewhere)}
    assert elsewhere.read_bytes() == (folder / STATEMENT).read_bytes()
    os.unlink(folder / "findings.nc")
    with pytest.raises(InputError, match=r"findings\.nc"):
        attest(folder, keys[0])
