# Folders and the user that robots run as; nothing that runs is touched.
if ! id ahdc >/dev/null 2>&1; then
  useradd --system --no-create-home --home-dir / --shell /usr/sbin/nologin ahdc
  mkdir -p "$ROOT$FOLDER"; touch "$ROOT$FOLDER/made-user"
fi
umask 022
mkdir -p "$ROOT$FOLDER/wheels" "$ROOT$FOLDER/envs" "$ROOT$FOLDER/releases"
chgrp ahdc "$ROOT$FOLDER"
chmod 750 "$ROOT$FOLDER"
