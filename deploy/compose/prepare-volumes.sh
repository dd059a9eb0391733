# Runs before the full profile's services, as root of a container without network: makes the bucket, and hands the secrets
# of .env to those who need them as files. Once more does no harm.
set -eu
umask 077

mkdir -p /s3/firstfix
chown 10001:10001 /s3 /s3/firstfix /gateway /nats
chmod 700 /s3 /gateway /nats

printf 'firstfix:%s\n' "$NATS_PASSWORD" >/secrets/nats
cat >/secrets/replica.json5 <<EOF
// The session of a replica: a peer that listens nowhere, so that it starts without the router.
{
  mode: "peer",
  listen: { endpoints: [] },
  connect: { endpoints: ["tcp/zenoh:7447"], exit_on_failure: false, timeout_ms: -1 },
  scouting: { multicast: { enabled: false } },
  transport: { auth: { usrpwd: { user: "replica", password: "$ZENOH_REPLICA_PASSWORD" } } },
}
EOF
chown -R 10001:10001 /secrets
chmod 755 /secrets

printf 'replica:%s\nrobot:%s\n' "$ZENOH_REPLICA_PASSWORD" "$ZENOH_ROBOT_PASSWORD" >/router/users.txt
chmod 755 /router

printf '%s' "$FIRSTFIX_METRICS_KEY" >/monitor/key
chown 65534:65534 /monitor/key  # the user of Prometheus's image
chmod 755 /monitor
