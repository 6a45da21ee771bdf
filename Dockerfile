# The notebooks in JupyterLab, for those who can't install them: by `docker build` and `docker run` (README), or on Binder, which
# passes NB_USER and NB_UID. It holds what environment.txt pins, and runs as a user without rights.
FROM python:3.11-slim-bookworm

RUN apt-get update \
    && apt-get install --yes --no-install-recommends git libegl1 libopengl0 libgl1-mesa-dri make \
    && rm -rf /var/lib/apt/lists/*

ARG NB_USER=student
ARG NB_UID=1000
RUN useradd --create-home --uid ${NB_UID} ${NB_USER}
ENV HOME=/home/${NB_USER} PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR ${HOME}/clothlab

# Packages first: they are installed again only when the lock changes. PyTorch comes without CUDA, which is several
# gigabytes smaller.
COPY environment.txt ./
RUN pip install uv && grep '==' environment.txt > pins.txt \
    && uv pip install --system --no-cache --torch-backend=cpu --requirement pins.txt && rm pins.txt

COPY --chown=${NB_UID} . ./
RUN pip install --no-deps --editable . && chown ${NB_UID} .

RUN mkdir -p /usr/local/etc/jupyter && cp jupyter_lab_config.py /usr/local/etc/jupyter/

USER ${NB_USER}
EXPOSE 8888
CMD ["jupyter", "lab", "--ip=0.0.0.0", "--port=8888", "--no-browser", \
    "--LabApp.default_url=/lab/tree/notebooks/00_start_here.ipynb"]
