# Train in a container, or run the tests:
#   docker build --target train -t iwalker . && docker run -v "$PWD/runs:/iwalker-jax/runs" iwalker
#   docker build --target test -t iwalker-test . && docker run iwalker-test
FROM python:3.11-slim AS train
# Films are drawn without a screen.
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1-mesa-dri && rm -rf /var/lib/apt/lists/*
WORKDIR /iwalker-jax
COPY . .
RUN pip install -e .
CMD python -m experiments.train

FROM train AS test
RUN pip install -e '.[test]'
CMD python -m pytest
