# What a robot's computer is. Changes nothing; prints name=value lines.
say() { printf '%s=%s\n' "$1" "$2"; }
say user "$(id -u)"
say machine "$(uname -m)"
say glibc "$(getconf GNU_LIBC_VERSION 2>/dev/null | cut -d' ' -f2)"
say systemd "$(systemctl --version 2>/dev/null | awk 'NR == 1 { print $2 }')"
say booted "$([ -d "$ROOT/run/systemd/system" ] && echo yes || echo no)"
say rsync "$(command -v rsync || true)"
for name in python3.13 python3.12 python3.11 python3; do
  python=$(command -v "$name") || continue
  if version=$("$python" -c 'import sys, venv; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null); then
    case $version in 3.11.* | 3.12.* | 3.13.*) say python "$python"; say version "$version"; break ;; esac
  fi
done
at="$ROOT$FOLDER"
while [ ! -d "$at" ]; do at=$(dirname "$at"); done
say disk_mb "$(df -Pm "$at" | awk 'NR == 2 { print $4 }')"
say current "$(basename "$(readlink "$ROOT$FOLDER/current" 2>/dev/null || true)")"
say previous "$(cat "$ROOT$FOLDER/previous" 2>/dev/null || true)"
say leap "$(timeout 5 chronyc -n tracking 2>/dev/null | awk -F': ' '/^Leap status/ { print $2 }')"
say clock "$(date +%s.%N)"
