# The service on a CPU, without graphics:
#   docker build --tag grasptransfer .
#   docker run --rm --publish 127.0.0.1:5556:5556 grasptransfer
# From another process: grasptransfer/service/client.py, which needs pyzmq and msgpack alone.
FROM python:3.11-slim AS build
WORKDIR /source
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY grasptransfer grasptransfer
COPY objects objects
COPY examples examples
# PyTorch's own index has wheels without CUDA, which are some gigabytes smaller.
RUN python -m venv /opt/grasptransfer \
    && /opt/grasptransfer/bin/pip install --no-cache-dir --constraint constraints.txt \
        --extra-index-url https://download.pytorch.org/whl/cpu ".[serve,fast]"

FROM python:3.11-slim
COPY --from=build /opt/grasptransfer /opt/grasptransfer
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin service
# What is compiled while it runs is kept where the user without rights may write.
ENV PATH=/opt/grasptransfer/bin:$PATH NUMBA_CACHE_DIR=/tmp/numba PYTHONUNBUFFERED=1
USER 10001
EXPOSE 5556
HEALTHCHECK --interval=30s --timeout=10s --start-period=60s \
    CMD ["python", "-c", "from grasptransfer.service.client import Client; Client(timeout=8).health()"]
# Inside the container every address is its own; who may ask is decided by --publish.
CMD ["grasptransfer", "serve", "--host", "0.0.0.0"]
