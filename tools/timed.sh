#!/usr/bin/env bash
# Say what a command does and how long it took here last time, and run it: timed.sh FOLDER NAME TEXT COMMAND ...
set -euo pipefail

folder=$1 name=$2 text=$3
shift 3
last="$folder/.seconds_of_$name"
before=""
if [ -s "$last" ]; then
  before=" (it took $(cat "$last") s here last time)"
fi
printf '%s: %s%s\n' "$name" "$text" "$before"
began=$SECONDS
"$@"
printf '%s\n' "$((SECONDS - began))" > "$last"
