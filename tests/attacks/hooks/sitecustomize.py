"""Lets functions of ``os`` fail in a process under attack, as the file in ATTACK_SWITCH says.

``{"error": 5, "calls": ["stat"], "folder": "/x"}`` lets ``os.stat`` of paths in /x raise EIO as long as the file is
there; without a folder on any path or descriptor. ``thread`` among the calls: no thread can be started.
"""

import _thread
import json
import os
import threading

_SWITCH = os.environ.get("ATTACK_SWITCH", "")
_open, _read, _close, _strerror = os.open, os.read, os.close, os.strerror


def _setting():
    try:
        descriptor = _open(_SWITCH, os.O_RDONLY)
    except OSError:
        return None
    try:
        return json.loads(_read(descriptor, 10_000))
    finally:
        _close(descriptor)


def _failing(name, function):
    def call(*arguments, **options):
        setting = _setting()
        if setting and name in setting["calls"]:
            place = arguments[0] if arguments else ""
            text = os.fspath(place) if isinstance(place, (str, bytes, os.PathLike)) else ""
            if isinstance(text, str) and (not setting["folder"] or text.startswith(setting["folder"])):
                raise OSError(setting["error"], _strerror(setting["error"]), text or None)
        return function(*arguments, **options)

    return call


def _no_thread(function):
    def call(*arguments, **options):
        setting = _setting()
        if setting and "thread" in setting["calls"]:
            raise RuntimeError("can't start new thread")
        return function(*arguments, **options)

    return call


if _SWITCH:
    for _name in (
        "stat", "lstat", "open", "mkdir", "statvfs", "fstat", "fsync", "fdatasync", "pwrite", "ftruncate", "unlink",
        "listdir", "scandir", "rename", "replace", "link",
    ):  # fmt: skip
        setattr(os, _name, _failing(_name, getattr(os, _name)))
    for _module, _name in (
        (threading, "_start_new_thread"), (threading, "_start_joinable_thread"), (_thread, "start_new_thread")
    ):  # fmt: skip
        if hasattr(_module, _name):
            setattr(_module, _name, _no_thread(getattr(_module, _name)))
