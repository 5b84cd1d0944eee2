#!/bin/sh
# Write the sample trials: the four variants of Table 2, three repetitions each, virtual logs of a robot
# on sand that scatters from trial to trial, and that has two effects which the paper suspects and its
# model lacks. The answer is sealed beside them; the true motion is kept aside in truth/.
# Usage: data/make-samples.sh [granite-lab]
set -eu
lab=${1:-granite-lab}
here=$(dirname "$0")/samples
rm -f "$here"/virtual_v*_r*.csv "$here"/truth/virtual_v*_r*.csv "$here/sealed.bin"
"$lab" hide --effect tyre_windup+drive_reaction --seed 2021 --name virtual \
    --out "$here" --truth "$here/truth" --jobs 0
