#!/bin/sh
# Minari on a data set in Arrow's format whose infos are numbers, one per step, as most environments' are.
#
# Seen with minari 0.5.4: an episode of two steps with infos of shape (3,) is written without a word, and
# reading it ends in ValueError: invalid literal for int() with base 10: b''. With infos of shape (3, 1) it is
# read back as it was, and two such data sets are combined.
#
# Guess beforehand: what create_dataset_from_buffers takes, iterate_episodes gives back, in either format.
# What seems to happen: an info's shape is kept as text beside its column, that of a number is the empty
# text, and that is split into one word which is no number.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "minari[arrow]==0.5.4" "gymnasium==1.4.0" "numpy==2.4.6"
cat > combined.py <<'PYTHON'
import os
import sys
import warnings
from importlib.metadata import version

warnings.simplefilter("ignore")
os.environ["MINARI_DATASETS_PATH"] = os.path.abspath("sets")

import gymnasium
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer

BOX = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)


def made(name, infos):
    episode = EpisodeBuffer(
        id=0,
        seed=0,
        observations=np.zeros((3, 2), np.float32),
        actions=np.zeros((2, 2), np.float32),
        rewards=[1.0, 2.0],
        terminations=[False, True],
        truncations=[False, False],
        infos={"level": infos},
    )
    return minari.create_dataset_from_buffers(
        name, [episode], observation_space=BOX, action_space=BOX, data_format="arrow"
    )


def levels(data):
    try:
        return [np.ravel(each.infos["level"]).tolist() for each in data.iterate_episodes()]
    except Exception as error:
        return f"{type(error).__name__}: {error}"


print(f"minari {version('minari')}")
read = {}
for shape in ((3,), (3, 1)):
    word = "-".join(map(str, shape))
    infos = np.array([0, 1, 2]).reshape(shape)
    parts = [made(f"stone/part{word}-{k}-v0", infos) for k in range(2)]
    read[shape] = [levels(part) for part in parts]
    print(f"infos of shape {shape}: {read[shape]}")
both = levels(minari.combine_datasets(parts, "stone/both-v0"))
print(f"combined: {both}")
whole = [[0, 1, 2]]
sys.exit(
    read[3, 1] != [whole] * 2
    or both != 2 * whole
    or not all(str(each).startswith("ValueError") for each in read[3,])
)
PYTHON
env/bin/python combined.py
