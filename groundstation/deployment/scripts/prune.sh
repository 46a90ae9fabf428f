# Keep the release that runs and the one before; drop the others, and environments that nobody uses.
base="$ROOT$FOLDER"
current=$(basename "$(readlink "$base/current")") previous=$(cat "$base/previous" 2>/dev/null || true)
for path in "$base"/releases/*; do
  case $(basename "$path") in "$current" | "$previous") ;; *) rm -rf "$path" ;; esac
done
for path in "$base"/envs/*; do
  name=$(basename "$path") used=
  for link in "$base"/releases/*/env; do
    if [ "$(basename "$(readlink "$link" || true)")" = "$name" ]; then used=yes; fi
  done
  if [ -z "$used" ]; then rm -rf "$path"; fi
done
