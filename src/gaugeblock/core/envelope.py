"""Signed content: a DSSE envelope (dead simple signing envelope, version 1) with Ed25519 signatures.

https://github.com/secure-systems-lab/dsse: what is signed is the content with its type and their lengths, so
that no content can be taken for another kind of thing.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import InputError, require
from gaugeblock.core.foreign import TEXT, read_bytes

PASSPHRASE = "GAUGEBLOCK_KEY_PASSPHRASE"
MAKE = "openssl genpkey -algorithm ed25519 makes one"
SHOW = "openssl pkey -in KEY.pem -pubout makes it of the private one"


class Unsealed(ValueError):
    """An envelope that does not hold: the message says why, in a few words."""


def private_key(path: Path) -> Any:
    """An Ed25519 key to sign with, in PEM (PKCS8); the passphrase of an encrypted one is in the environment.

    Raises
    ------
    InputError
        If it cannot be read, is no such key, or its passphrase is missing or wrong.
    MissingExtraError
        Without cryptography.
    """
    serialization, ed25519 = _library()
    content = read_bytes(path, most=TEXT)
    word = None
    if b"ENCRYPTED" in content:
        if not os.environ.get(PASSPHRASE):
            raise InputError(f"{path}: is encrypted; give its passphrase in the environment, as {PASSPHRASE}")
        word = os.environ[PASSPHRASE].encode()
    try:
        key = serialization.load_pem_private_key(content, word)
    except Exception as error:  # several kinds of the library's own
        why = f"the passphrase in {PASSPHRASE} may be wrong" if word else f"PEM, PKCS8; {MAKE}"
        raise InputError(f"{path}: cannot be read as a private key ({why})") from error
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise InputError(f"{path}: is no Ed25519 key; {MAKE}")
    return key


def public_key(path: Path) -> Any:
    """An Ed25519 key to check with, in PEM.

    Raises
    ------
    InputError
        If it cannot be read, or is no such key.
    MissingExtraError
        Without cryptography.
    """
    serialization, ed25519 = _library()
    content = read_bytes(path, most=TEXT)
    if b"PRIVATE KEY" in content:
        raise InputError(f"{path}: is a private key; give the public one: {SHOW}")
    try:
        key = serialization.load_pem_public_key(content)
    except Exception as error:
        raise InputError(f"{path}: cannot be read as a public key (PEM; {SHOW})") from error
    if not isinstance(key, ed25519.Ed25519PublicKey):
        raise InputError(f"{path}: is no Ed25519 key; {SHOW}")
    return key


def sealed(payload: bytes, kind: str, key: Any) -> bytes:
    """An envelope, as JSON, with one signature; the same bytes whenever the same key signs the same."""
    signature = {"keyid": key_digest(key.public_key()), "sig": _text(key.sign(_signed(payload, kind)))}
    content = {"payload": _text(payload), "payloadType": kind, "signatures": [signature]}
    return (json.dumps(content, indent=2, sort_keys=True) + "\n").encode()


def unsealed(content: bytes, kind: str, key: Any) -> bytes:
    """What is in an envelope that this public key signed, whoever else did.

    Raises
    ------
    Unsealed
        If it is no envelope, of another kind, or not signed by the key.
    """
    try:
        table = json.loads(content)
        payload, named = _bytes(table["payload"]), str(table["payloadType"])
        signatures = [_bytes(entry["sig"]) for entry in table["signatures"]]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise Unsealed("is no DSSE envelope") from None
    if named != kind:
        raise Unsealed(f"holds {named}, not {kind}")
    # Ids of keys are hints, and nothing is decided by them.
    if not any(_holds(key, signature, _signed(payload, kind)) for signature in signatures):
        raise Unsealed(f"is not signed by the key {key_digest(key)}, or what it holds was changed")
    return payload


def key_digest(key: Any) -> str:
    """SHA-256 of a public key as it is written in PEM, without the letters around it."""
    serialization, _ = _library()
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    return hashlib.sha256(key.public_bytes(serialization.Encoding.DER, form)).hexdigest()


def _signed(payload: bytes, kind: str) -> bytes:
    """What is signed: DSSE's pre-authentication encoding."""
    name = kind.encode()
    return b"DSSEv1 %d %s %d %s" % (len(name), name, len(payload), payload)


def _holds(key: Any, signature: bytes, content: bytes) -> bool:
    invalid = require("cryptography.exceptions", "sign").InvalidSignature
    try:
        key.verify(signature, content)
    except invalid:
        return False
    return True


def _library() -> tuple[Any, Any]:
    primitives = "cryptography.hazmat.primitives"
    return (
        require(f"{primitives}.serialization", "sign"),
        require(f"{primitives}.asymmetric.ed25519", "sign"),
    )


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _bytes(text: str) -> bytes:
    """Of either alphabet, as DSSE asks."""
    return base64.b64decode(text.replace("-", "+").replace("_", "/"), validate=True)
