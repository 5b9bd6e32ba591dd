"""Files as a whole: written under a temporary name and renamed, so that no reader ever sees half of one; looked at before they are opened."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from scan2fea.errors import EmptyScanError, InputError, UsageError, require

_BLOCK = 1 << 20
_FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))  # disk, file or quota


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A binary file that takes the name `path` only when the block ends well; otherwise nothing is left behind. Missing folders are made.

    Raises UsageError where the folder cannot be written to, or is full.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = temporary.open("wb")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}): choose another folder with -o") from error
    try:
        with handle:
            yield handle
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno in _FULL:
            raise UsageError(f"{path}: cannot be written ({error.strerror}): make room, or choose another folder with -o") from error
        raise


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` under the name `path`, whole or not at all."""
    with replacing(path) as handle:
        handle.write(content)


def existing_file(path: Path) -> int:
    """Size in bytes of a file that can be read. Raises InputError (missing, a folder, not readable), EmptyScanError (0 bytes)."""
    path = Path(path)
    require(not path.is_dir(), InputError, f"{path} is a folder: name the files in it")
    try:
        with path.open("rb"):
            pass
        require(path.is_file(), InputError, f"{path} is not a regular file: copy its content to one")
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check the name and the permissions") from error
    require(size > 0, EmptyScanError, f"{path} is empty (0 bytes): export or copy it again")
    return size


def sha256_of(path: Path) -> str:
    """Hexadecimal SHA-256 of a file."""
    digest = hashlib.sha256()
    with Path(path).open("rb") as handle:
        while block := handle.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 under the name `path`, whole or not at all."""
    write_bytes(path, text.encode())
