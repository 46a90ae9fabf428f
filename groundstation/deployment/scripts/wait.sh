# Until the unit says that it is well as this release and goes on saying so in one process; prints what it is.
look() { systemctl show "$UNIT" -p ActiveState,SubState,StatusText,NRestarts,MainPID,Result; }
steady=0 was=
for turn in $(seq "$TURNS"); do
  now=$(look)
  process=$(printf '%s\n' "$now" | grep -E '^(MainPID|NRestarts)=' || true)
  well=
  case $now in *"[$RELEASE]"*) case $now in
    *ActiveState=active*) well=yes ;;
    *"StatusText=waits for"*) [ "$WANTED" = ready ] || well=yes ;;
  esac ;; esac
  if [ -n "$well" ] && { [ "$process" = "$was" ] || [ "$WANTED" != ready ]; }; then steady=$((steady + 1)); else steady=0; fi
  if [ "$steady" -ge "$STEADY" ]; then break; fi
  was=$process
  sleep "$PAUSE"
done
printf '%s\n' "$now"
echo "Steady=$steady"
if [ "$steady" -lt "$STEADY" ]; then
  journalctl -q -t "ahdc-$ROBOT" -n 15 -o cat --no-pager 2>/dev/null | sed 's/^/Journal=/'
fi
