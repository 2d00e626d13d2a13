"""Envelopes and keys, by cryptography's own calls and bytes that are put together here."""

from __future__ import annotations

import base64
import hashlib
import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tests import refusals

from gaugeblock.core.envelope import (
    PASSPHRASE,
    Unsealed,
    key_digest,
    private_key,
    public_key,
    sealed,
    unsealed,
)
from gaugeblock.core.errors import InputError

serialization = pytest.importorskip("cryptography.hazmat.primitives.serialization")
ed25519 = pytest.importorskip("cryptography.hazmat.primitives.asymmetric.ed25519")
KEY = ed25519.Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
OTHER = ed25519.Ed25519PrivateKey.from_private_bytes(bytes(32))
KIND = "application/x"


def pem(key: Any, word: bytes | None = None) -> bytes:
    lock = serialization.BestAvailableEncryption(word) if word else serialization.NoEncryption()
    return bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, lock))


def public_pem(key: Any) -> bytes:
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    return bytes(key.public_key().public_bytes(serialization.Encoding.PEM, form))


def digest(key: Any) -> str:
    body = b"".join(public_pem(key).splitlines()[1:-1])
    return hashlib.sha256(base64.b64decode(body)).hexdigest()


said = partial(refusals.said, kind=(InputError, Unsealed))


def test_an_envelope_is_what_the_standard_says() -> None:
    payload = bytes(range(250, 256)) * 3
    made = sealed(payload, KIND, KEY)
    signature = KEY.sign(b"DSSEv1 13 application/x 18 " + payload)
    content = {
        "payload": base64.b64encode(payload).decode(),
        "payloadType": KIND,
        "signatures": [{"keyid": digest(KEY), "sig": base64.b64encode(signature).decode()}],
    }
    assert made.decode() == json.dumps(content, indent=2, sort_keys=True) + "\n"
    assert unsealed(made, KIND, KEY.public_key()) == payload
    assert key_digest(KEY.public_key()) == digest(KEY)
    # Either alphabet; keys' ids decide nothing; others may have signed as well.
    own = content["signatures"][0]["sig"].replace("+", "-").replace("/", "_")  # type: ignore[index]
    content["payload"] = base64.urlsafe_b64encode(payload).decode()
    content["signatures"] = [{"sig": "AAAA", "keyid": digest(KEY)}, {"sig": own}]
    assert unsealed(json.dumps(content).encode(), KIND, KEY.public_key()) == payload


def test_what_does_not_hold() -> None:
    made = json.loads(sealed(b"one", KIND, KEY))
    mine = KEY.public_key()

    def told(**changes: Any) -> str:
        return said(unsealed, json.dumps({**made, **changes}).encode(), KIND, mine)

    changed = f"is not signed by the key {digest(KEY)}, or what it holds was changed"
    assert told(payload=base64.b64encode(b"two").decode()) == changed
    assert told(signatures=[]) == changed
    assert told(signatures=json.loads(sealed(b"one", KIND, OTHER))["signatures"]) == changed
    assert told(payloadType="application/y") == "holds application/y, not application/x"
    for broken in (
        {"payload": "a b"},
        {"payload": 3},
        {"signatures": [{}]},
        {"signatures": 3},
        {"signatures": ["a"]},
    ):
        assert told(**broken) == "is no DSSE envelope"
    for content in (b"", b"[]", b"3", b"[" * 100_000, b"\xff"):
        assert said(unsealed, content, KIND, mine) == "is no DSSE envelope"


def test_keys_that_cannot_be_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "key.pem"
    make = "openssl genpkey -algorithm ed25519 makes one"
    show = "openssl pkey -in KEY.pem -pubout makes it of the private one"
    monkeypatch.delenv(PASSPHRASE, raising=False)
    path.write_bytes(pem(KEY))
    assert private_key(path).sign(b"a") == KEY.sign(b"a")
    assert said(public_key, path) == f"{path}: is a private key; give the public one: {show}"
    path.write_bytes(public_pem(KEY))
    assert key_digest(public_key(path)) == digest(KEY)
    assert said(private_key, path) == f"{path}: cannot be read as a private key (PEM, PKCS8; {make})"
    path.write_bytes(b"nothing")
    assert said(public_key, path) == f"{path}: cannot be read as a public key (PEM; {show})"
    path.write_bytes(pem(KEY, b"word"))
    locked = f"{path}: is encrypted; give its passphrase in the environment, as {PASSPHRASE}"
    assert said(private_key, path) == locked
    monkeypatch.setenv(PASSPHRASE, "")
    assert said(private_key, path) == locked
    monkeypatch.setenv(PASSPHRASE, "other")
    assert said(private_key, path) == (
        f"{path}: cannot be read as a private key (the passphrase in {PASSPHRASE} may be wrong)"
    )
    monkeypatch.setenv(PASSPHRASE, "word")
    assert private_key(path).sign(b"a") == KEY.sign(b"a")
    path.write_bytes(pem(KEY))
    assert private_key(path).sign(b"a") == KEY.sign(b"a")  # of one that is not encrypted it is not asked
    x25519 = pytest.importorskip("cryptography.hazmat.primitives.asymmetric.x25519")
    other = x25519.X25519PrivateKey.from_private_bytes(bytes(range(32)))
    path.write_bytes(pem(other))
    assert said(private_key, path) == f"{path}: is no Ed25519 key; {make}"
    path.write_bytes(public_pem(other))
    assert said(public_key, path) == f"{path}: is no Ed25519 key; {show}"
