#!/usr/bin/env bash
# Writes .env from .env.example with random secrets. One that is there is left as it is.
#
#   ./make-env.sh [FILE]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
to=${1:-$here/.env}
if [ -e "$to" ]; then echo "$to is there already" >&2; exit 0; fi

random() { od -An -N"$1" -tx1 /dev/urandom | tr -d ' \n'; }  # BYTES, as hex
umask 077
while IFS= read -r line; do
  case $line in
    FIRSTFIX_ADMIN_KEY= | FIRSTFIX_METRICS_KEY=) echo "${line}ffx_$(random 6)_$(random 32)" ;;
    # Begins with a letter, or NATS would take some for numbers.
    S3_*= | NATS_PASSWORD= | ZENOH_*_PASSWORD= | GRAFANA_PASSWORD=) echo "${line}s$(random 20)" ;;
    *) echo "$line" ;;
  esac
done <"$here/.env.example" >"$to.part"
mv "$to.part" "$to"
echo "wrote $to: keep it, and keep it to yourself"
