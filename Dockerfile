# uuv-arm on a minimal Debian (x86-64), from the wheel: no screen, GL or compiler.
#
#   bash .ci/wheel
#   docker build --tag uuv-arm .
#   docker run --rm --volume "$PWD:/work" --volume uuv-cache:/root/.cache uuv-arm run clean-barrel --quick
#
# The second volume keeps the compiled kernels for the next run.
FROM debian:bookworm-slim
RUN apt-get update && apt-get install --yes --no-install-recommends python3 python3-venv && rm -rf /var/lib/apt/lists/*
COPY dist/uuv_arm-*.whl /tmp/
RUN python3 -m venv /opt/uuv && /opt/uuv/bin/pip install --no-cache-dir "$(ls /tmp/uuv_arm-*.whl)[perception,log]" && rm /tmp/uuv_arm-*.whl
ENV PATH=/opt/uuv/bin:$PATH
WORKDIR /work
ENTRYPOINT ["uuv"]
CMD ["list"]
