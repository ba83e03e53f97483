# foldback with Dask: scheduler, workers and `foldback sweep` on Kubernetes and other containers.
# It is the image of the service with the extra `sweep`, which the service does not need.
#
#   docker build -f deploy/Dockerfile -t foldback:local .
#   docker build -f deploy/sweep.Dockerfile -t foldback-sweep .

FROM foldback:local

USER 0:0
COPY constraints.txt pyproject.toml /tmp/
RUN python3 -c "import tomllib; p = tomllib.load(open('/tmp/pyproject.toml', 'rb'))['project']; print(*p['optional-dependencies']['sweep'], sep='\n')" > /tmp/requirements.txt \
    && python3 -m pip install --no-cache-dir --constraint /tmp/constraints.txt --requirement /tmp/requirements.txt \
    && rm /tmp/constraints.txt /tmp/pyproject.toml /tmp/requirements.txt
USER 10001:10001
# The health check of the service would fail: nothing listens on its port.
HEALTHCHECK NONE
ENTRYPOINT ["dask"]
CMD ["--help"]
