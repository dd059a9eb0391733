#!/usr/bin/env bash
# Sees to it that the images that compose.yaml names are here: as they are, pulled, or, where no registry can be reached, made
# from packages under the same names (NATS and versitygw by `go install`, HAProxy and Prometheus from Debian, the zenoh router
# from the zenoh package of firstfix-service). For Grafana there is no such package. Needs docker, go, firstfix-service.
#
#   DOCKER_BUILD_ARGS="--network host" deploy/stand-ins/build.sh
set -euo pipefail
cd "$(dirname "$0")"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
read -r -a build_args <<<"${DOCKER_BUILD_ARGS:-}"

here() { docker image inspect "$1" >/dev/null 2>&1 || timeout 60 docker pull -q "$1" >/dev/null 2>&1; }
make_image() {  # NAME, Dockerfile on standard input
  echo "making a stand-in for $1"
  docker build -q "${build_args[@]}" -t "$1" -f - "$work" >/dev/null
}
go_program() { CGO_ENABLED=0 GOBIN="$work" go install "$1"; }

here debian:bookworm-slim || ./debian.sh

if ! here versity/versitygw:v1.8.0; then
  go_program github.com/versity/versitygw/cmd/versitygw@v1.8.0
  make_image versity/versitygw:v1.8.0 <<'EOF'
FROM debian:bookworm-slim
COPY versitygw /app/versitygw
ENTRYPOINT ["/app/versitygw"]
EOF
fi

if ! here nats:2.10.22; then
  go_program github.com/nats-io/nats-server/v2@v2.10.22
  make_image nats:2.10.22 <<'EOF'
FROM debian:bookworm-slim
COPY nats-server /nats-server
ENTRYPOINT ["/nats-server"]
EOF
fi

if ! here haproxy:2.6; then
  make_image haproxy:2.6 <<'EOF'
FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y --no-install-recommends haproxy && rm -rf /var/lib/apt/lists/*
USER haproxy
STOPSIGNAL SIGUSR1
ENTRYPOINT ["haproxy", "-W", "-db", "-f", "/usr/local/etc/haproxy/haproxy.cfg"]
EOF
fi

if ! here prom/prometheus:v2.42.0; then
  make_image prom/prometheus:v2.42.0 <<'EOF'
FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y --no-install-recommends prometheus && rm -rf /var/lib/apt/lists/* \
 && install -d -o nobody -g nogroup /prometheus
USER nobody
ENTRYPOINT ["/usr/bin/prometheus"]
EOF
fi

if ! here eclipse/zenoh:1.10.2; then
  cp zenohd.py "$work/"
  make_image eclipse/zenoh:1.10.2 <<'EOF'
FROM firstfix-service
USER root
COPY zenohd.py /zenohd.py
HEALTHCHECK NONE
ENTRYPOINT ["python", "/zenohd.py"]
CMD []
EOF
fi
