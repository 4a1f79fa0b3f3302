#!/bin/sh
# Healthy (exit code 0): this container's process turned less than 10 s ago, as its heartbeat says. One that has not for
# 20 s is killed, and docker's restart policy begins it anew. Before its first beat it starts: nothing is killed.
set -eu
beat=$(cat "$SPOT3D_LINK__HEARTBEAT" 2>/dev/null) || exit 1
read -r up _ </proc/uptime
age=$((${up%.*} - ${beat% *}))
[ "$age" -ge 10 ] || exit 0
echo "no heartbeat for $age s"
[ "$age" -ge 20 ] || exit 1
# After `docker unpause` the beat is as old as the pause was long: a process that turns has the time to beat.
sleep 3
[ "$(cat "$SPOT3D_LINK__HEARTBEAT" 2>/dev/null)" = "$beat" ] || exit 1
kill -KILL "${beat#* }" && echo "killed"
exit 1
