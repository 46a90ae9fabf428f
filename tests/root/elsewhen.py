"""``elsewhen.py SECONDS COMMAND...``: a command whose monotonic clock is ahead by so much (time_namespaces(7))."""

import ctypes
import os
import sys
from pathlib import Path

CLONE_NEWTIME = 0x80

seconds, command = int(sys.argv[1]), sys.argv[2:]
libc = ctypes.CDLL(None, use_errno=True)
if libc.unshare(CLONE_NEWTIME):
    sys.exit(f"unshare: {os.strerror(ctypes.get_errno())}")
Path("/proc/self/timens_offsets").write_text(f"monotonic {seconds} 0\nboottime {seconds} 0\n")
namespace = os.open("/proc/self/ns/time_for_children", os.O_RDONLY | os.O_CLOEXEC)
if libc.setns(namespace, CLONE_NEWTIME):
    sys.exit(f"setns: {os.strerror(ctypes.get_errno())}")
os.execvp(command[0], command)
