#!/bin/sh
# Write the sample trials: the four variants of Table 2, three repetitions each, virtual logs of
# the paper's model on sand that scatters from trial to trial. The true motion is kept aside.
# Usage: data/make-samples.sh [granite-lab]
set -eu
lab=${1:-granite-lab}
here=$(dirname "$0")/samples
seed=100
for speed in 0.2 0.3 0.5 0.7; do
    for repetition in 1 2 3; do
        seed=$((seed + 1))
        name=virtual_v${speed}_r${repetition}
        "$lab" simulate --variant "$speed" --scatter --seed "$seed" --repetition "$repetition" \
            --log "$here/$name.csv" --truth "$here/truth/$name.csv" \
            --out "${TMPDIR:-/tmp}/granite-lab-$name.csv" >/dev/null
        rm -f "${TMPDIR:-/tmp}/granite-lab-$name.csv"
        echo "$name"
    done
done
