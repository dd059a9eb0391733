# Two targets over one tree of packages, both without compiler, pip or root:
#   service   answers queries over HTTP and zenoh, and is the gateway of ROS 2's robots; has no open3d, so it builds no maps
#   builder   the same and the mesh tools: `firstfix serve` with in-process builds, `firstfix worker`, `firstfix build`;
#             and Dask, for `dask scheduler` and `dask worker` (docs/how-to/deploy.md)
#
#   deploy/image/build.sh                                       # both, with version and revision in their labels
#   docker build --target service -t firstfix-service .
#
# They run as user 10001 with a read-only root file system: what they write is in /var/lib/firstfix (a volume) and /tmp
# (a tmpfs). They listen beyond the container, so they start only with FIRSTFIX_AUTH=on, or off where nobody else gets
# there. /usr/share/sbom/firstfix.cdx.json says what is in them.
#
# A machine with a package index of its own gives it with --build-arg PIP_INDEX_URL=..., one with a registry of npm's packages of
# its own --build-arg NPM_CONFIG_REGISTRY=..., and one that pins its base image --build-arg BASE=debian:bookworm-slim@sha256:...
# FIRSTFIX_MODULES=avx2 compiles the core for these processors alone: for a try, as others then cannot start the image.
ARG BASE=debian:bookworm-slim
FROM $BASE AS python
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 libgomp1 \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/log/*

FROM python AS tools
ARG PIP_INDEX_URL
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv binutils
COPY deploy/locks/setup.txt /locks/
RUN python3 -m venv /opt/tools \
 && /opt/tools/bin/pip install --quiet --require-hashes -r /locks/setup.txt \
 && python3 -m venv --without-pip /opt/firstfix
COPY deploy/image /image

# The page at /console/. Where its packages cannot be had, the script goes on without it, and the next stage's COPY fails.
FROM tools AS console
ARG NPM_CONFIG_REGISTRY
COPY plugins/console /src/plugins/console
COPY docs/openapi.json /src/docs/
# The sources are checked by `make console`, before they are committed.
RUN STEPS="types build" PYTHON=/opt/tools/bin/python /src/plugins/console/build.sh

# The one stage with a compiler.
FROM tools AS wheel
RUN apt-get install -y --no-install-recommends g++ python3-dev
COPY . /src
COPY --from=console /src/plugins/console/firstfix_console/files /src/plugins/console/firstfix_console/files
ARG FIRSTFIX_MODULES
RUN /opt/tools/bin/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir /wheel \
    --config-settings=cmake.define.FIRSTFIX_MODULES="$FIRSTFIX_MODULES" /src \
 && /opt/tools/bin/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir /wheel /src/plugins/console /src/plugins/fleet

# Without bytecode: slim.py leaves that of what is used.
FROM tools AS service-packages
ARG PIP_INDEX_URL
COPY deploy/locks/service.txt /locks/
RUN /opt/tools/bin/pip --python /opt/firstfix/bin/python install --quiet --no-compile --only-binary :all: --require-hashes -r /locks/service.txt

FROM service-packages AS service-venv
COPY --from=wheel /wheel /wheel
RUN /opt/tools/bin/pip --python /opt/firstfix/bin/python install --quiet --no-compile --no-deps --no-index /wheel/*.whl \
 && python3 /image/slim.py /opt/firstfix service

# What both images share: the user, the place of the data, how it is started and watched.
FROM python AS runtime
RUN groupadd --gid 10001 firstfix \
 && useradd --uid 10001 --gid 10001 --no-create-home --home-dir /tmp --shell /usr/sbin/nologin firstfix \
 && install -d -o firstfix -g firstfix /var/lib/firstfix
ENV PATH=/opt/firstfix/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    HOME=/tmp \
    FIRSTFIX_STORE=file:///var/lib/firstfix/store \
    FIRSTFIX_WORK_DIR=/var/lib/firstfix/work \
    FIRSTFIX_CACHE_DIR=/var/lib/firstfix/cache \
    FIRSTFIX_HOST=0.0.0.0 \
    FIRSTFIX_PORT=8080 \
    FIRSTFIX_ZENOH_LISTEN='["tcp/0.0.0.0:7447"]'
VOLUME /var/lib/firstfix
EXPOSE 8080 7447
HEALTHCHECK --interval=10s --timeout=5s --start-period=30s --retries=3 \
  CMD ["python", "-c", "import os, urllib.request as u; u.urlopen('http://127.0.0.1:' + os.environ['FIRSTFIX_PORT'] + '/healthz', timeout=4)"]
ENTRYPOINT ["firstfix"]
CMD ["serve"]

FROM runtime AS service-files
COPY --from=service-venv /opt/firstfix /opt/firstfix

FROM service-files AS service-sbom
ARG VERSION=0
COPY deploy/image/sbom.py /
RUN python3 /sbom.py /opt/firstfix firstfix-service "$VERSION" >/firstfix.cdx.json

FROM service-files AS service
COPY --from=service-sbom /firstfix.cdx.json /usr/share/sbom/
ARG VERSION=0
ARG REVISION=unknown
ARG CREATED=unknown
LABEL org.opencontainers.image.title="firstfix-service" \
      org.opencontainers.image.description="The first fix for LiDAR robots: one scan in, the pose in the map out" \
      org.opencontainers.image.licenses="Apache-2.0" \
      org.opencontainers.image.base.name="debian:bookworm-slim" \
      org.opencontainers.image.version=$VERSION \
      org.opencontainers.image.revision=$REVISION \
      org.opencontainers.image.created=$CREATED
USER 10001:10001

FROM tools AS builder-packages
ARG PIP_INDEX_URL
COPY deploy/locks/builder.txt /locks/
RUN /opt/tools/bin/pip --python /opt/firstfix/bin/python install --quiet --only-binary :all: --require-hashes -r /locks/builder.txt
# What open3d links, screen or not.
RUN apt-get install -y --no-install-recommends libgl1 libegl1 libx11-6 libudev1 libusb-1.0-0 libidn2-0

FROM builder-packages AS builder-venv
COPY --from=wheel /wheel /wheel
RUN /opt/tools/bin/pip --python /opt/firstfix/bin/python install --quiet --no-deps --no-index /wheel/*.whl \
 && python3 /image/slim.py /opt/firstfix builder

FROM runtime AS builder-files
RUN apt-get update \
 && apt-get install -y --no-install-recommends libgl1 libegl1 libx11-6 libudev1 libusb-1.0-0 libidn2-0 \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/log/*
ENV MPLBACKEND=Agg MPLCONFIGDIR=/tmp/matplotlib
COPY --from=builder-venv /opt/firstfix /opt/firstfix

FROM builder-files AS builder-sbom
ARG VERSION=0
COPY deploy/image/sbom.py /
RUN python3 /sbom.py /opt/firstfix firstfix-builder "$VERSION" >/firstfix.cdx.json

# Last, so that a plain `docker build .` gives the image that does everything.
FROM builder-files AS builder
COPY --from=builder-sbom /firstfix.cdx.json /usr/share/sbom/
ARG VERSION=0
ARG REVISION=unknown
ARG CREATED=unknown
LABEL org.opencontainers.image.title="firstfix-builder" \
      org.opencontainers.image.description="firstfix, and the tools that build its maps" \
      org.opencontainers.image.licenses="Apache-2.0" \
      org.opencontainers.image.base.name="debian:bookworm-slim" \
      org.opencontainers.image.version=$VERSION \
      org.opencontainers.image.revision=$REVISION \
      org.opencontainers.image.created=$CREATED
USER 10001:10001
