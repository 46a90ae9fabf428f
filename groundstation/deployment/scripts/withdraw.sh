# There is no release before this one to go back to: the robot runs nothing.
base="$ROOT$FOLDER"
systemctl disable --quiet --now "$UNIT" 2>/dev/null || true
rm -f "$ROOT/etc/systemd/system/$UNIT" "$ROOT/etc/udev/rules.d/$RULES" "$base/current"
systemctl daemon-reload
