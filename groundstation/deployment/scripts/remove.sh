# Everything that deploy has brought, taken away again.
base="$ROOT$FOLDER" parent=$(dirname "$ROOT$FOLDER") made=
if [ -e "$base/made-user" ]; then made=yes; fi
systemctl disable --quiet --now "$UNIT" 2>/dev/null || true
rm -f "$ROOT/etc/systemd/system/$UNIT" "$ROOT/etc/udev/rules.d/$RULES"
systemctl daemon-reload
systemctl reset-failed "$UNIT" 2>/dev/null || true
udevadm control --reload 2>/dev/null || true
rm -rf "$base"
if rmdir "$parent" 2>/dev/null; then
  if [ -n "$made" ]; then userdel ahdc; fi
elif [ -n "$made" ]; then
  for other in "$parent"/*; do touch "$other/made-user"; break; done
fi
