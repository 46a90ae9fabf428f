# The new release reads its files and knows its robot, as the user it will run as; wheels are not touched.
release="$ROOT$FOLDER/releases/$RELEASE"
as() { if [ "$(id -u)" = 0 ]; then runuser -u ahdc -- "$@"; else "$@"; fi; }
as "$release/env/bin/ahdc-onboard" check --arena "$release/arena.toml" --robot "$ROBOT"
