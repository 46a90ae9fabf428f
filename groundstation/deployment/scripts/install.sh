# The environment of a release, from the wheels beside it and from nowhere else. Each wheel's hash was sent by ssh.
umask 022
env="$ROOT$FOLDER/envs/$ENVIRONMENT" wheels="$ROOT$FOLDER/wheels" release="$ROOT$FOLDER/releases/$RELEASE"
if [ ! -e "$env/complete" ]; then
  rm -rf "$env"
  "$PYTHON" -m venv --without-pip "$env"
  printf '%s\n' "$REQUIREMENTS" >"$env/requirements.txt"
  echo "$PIP_SHA256  $wheels/$PIP" | sha256sum -c --status - || { echo "$PIP: hash differs, refused" >&2; exit 3; }
  "$env/bin/python" "$wheels/$PIP/pip" install --quiet --isolated --no-input --no-cache-dir --disable-pip-version-check \
    --root-user-action ignore --no-index --find-links "$wheels" --require-hashes --only-binary :all: --no-deps -r "$env/requirements.txt" \
    || { code=$?; rm -rf "$env"; echo "a wheel is missing or its hash differs: refused" >&2; exit $code; }
  touch "$env/complete"
fi
ln -sfn "../../envs/$ENVIRONMENT" "$release/env"
chgrp -R ahdc "$release"
chmod -R u=rwX,g=rX,o= "$release"
