#!/usr/bin/env bash
# A round of DAgger for the shipped policy, whose results are results/dagger.json. Takes some hours on one
# core; run it again to resume. benchmarks/evidence/dagger.sh [SEEDS], from the repository's root.
set -euo pipefail
top=$PWD out=runs/dagger start=$PWD/learning/policies/cma-robots-32px.safetensors
mkdir -p $out && cd $out
vlnpe=$top/.venv/bin/vlnpe
"$vlnpe" collect --robot aliengo --controller speed --scene 'builtin-exact:apartment*16' --train-scenes 8 \
  --splits train=100,val_unseen=96 --allow-fewer --seed 900 --camera ego:128x128 --no-mcap --out homes
"$vlnpe" dagger homes --policy cma-robots-32px --robot aliengo --beta 0.5 --out round
walk() { "$vlnpe" evaluate homes --split val_unseen --policy "$1" --robot aliengo --out "$2"; }
walk cma-robots-32px eval-shipped
for seed in ${1:-0}; do
  for mixture in expert both; do
    "$vlnpe" train "$top/benchmarks/evidence/dagger.yaml" --data . --mixture $mixture --start "$start" \
      --seed "$seed" --cache cache --out "train-$mixture-$seed"
    walk "train-$mixture-$seed/cma.safetensors" "eval-$mixture-$seed"
  done
  "$vlnpe" compare eval-shipped "eval-both-$seed"
  "$vlnpe" compare "eval-expert-$seed" "eval-both-$seed"
done
