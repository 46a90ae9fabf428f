# One rename makes the release the robot's; then its unit and rules, and a restart (disarmed).
base="$ROOT$FOLDER"
was=$(basename "$(readlink "$base/current" 2>/dev/null || true)")
ln -sfn "releases/$RELEASE" "$base/next"
mv -T "$base/next" "$base/current"
if [ -n "$was" ] && [ "$was" != "$RELEASE" ]; then echo "$was" >"$base/previous"; fi
mkdir -p "$ROOT/etc/systemd/system" "$ROOT/etc/udev/rules.d"
install -m 644 "$base/current/unit" "$ROOT/etc/systemd/system/$UNIT"
install -m 644 "$base/current/rules" "$ROOT/etc/udev/rules.d/$RULES"
udevadm control --reload 2>/dev/null || true
systemctl daemon-reload
systemctl enable --quiet "$UNIT"
systemctl reset-failed "$UNIT" 2>/dev/null || true
systemctl restart --no-block "$UNIT"
