#!/usr/bin/env bash
# The figures of rotating ellipsometry: errors against captures, principal components, angles, and two scenes captured in
# simulation (Figures 4, 5, 9 and 10 of Baek & Heide 2021, with the truth in place of a reference capture). About ten minutes
# on 2 cores; figures and tables go to validation/results/ellipsometry, all else to out/ellipsometry.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --release
sunstone=${CARGO_TARGET_DIR:-target}/release/sunstone
results=validation/results/ellipsometry
work=out/ellipsometry
mkdir -p "$results" "$work"

captures=2,3,4,5,6,7,8,9,10,11,12,14,16,18,20,24,30,36
search="--starts 6 --iterations 250 --adam-steps 300"
# Between frames of the plane of scattering, as tables and the paper have them; then as images do, whose frames are any.
"$sunstone" learn -k $captures --sensor intensity,polarizer-array --estimator least-squares,prior $search --frames plane \
    -o "$work/plane" --figure "$results/loss_plane.png" --csv "$results/loss_plane.csv"
"$sunstone" learn -k $captures --sensor intensity,polarizer-array --estimator least-squares,prior $search \
    -o "$work/learned" --save-prior "$work/prior.toml" --figure "$results/loss.png" --csv "$results/loss.csv"
"$sunstone" pbrdf pca -o "$results/components.png"
for k in 8 9 12 16 20 25 36; do
    "$sunstone" scheme drr -k $k --sensor polarizer-array -o "$work/drr_p_$k.toml"
done
for k in 20 22 25 28 30 36; do
    "$sunstone" scheme drr -k $k -o "$work/drr_$k.toml"
done
"$sunstone" scheme plot "$work/drr_36.toml" -o "$results/angles_drr_36.png"
"$sunstone" scheme plot "$work/learned/l-qrpr_16.toml" -o "$results/angles_l_qrpr_16.png"
"$sunstone" scheme plot "$work/learned/l-qrpr-p_8.toml" -o "$results/angles_l_qrpr_p_8.png"

# Scheme by scheme, least squares and, for few captures, the prior. The prior comes from the stand-ins alone: the mirror room's
# paints, gold, glass and mirror are not among them as they are there.
schemes=()
for k in 20 22 25 28 30 36; do schemes+=(--scheme "$work/drr_$k.toml"); done
for k in 8 9 12 16 20 25 36; do schemes+=(--scheme "$work/drr_p_$k.toml"); done
for k in 16 18 20 24 30 36; do schemes+=(--scheme "$work/learned/l-qrpr_$k.toml"); done
for k in 8 9 10 12 16 20 24 36; do schemes+=(--scheme "$work/learned/l-qrpr-p_$k.toml"); done
few=()
for k in 4 6 8 10 12 14; do few+=(--scheme "$work/learned/l-qrpr_${k}_prior.toml"); done
for k in 2 3 4 5 6 7; do few+=(--scheme "$work/learned/l-qrpr-p_${k}_prior.toml"); done
for scene in gold_mirror mirror_room; do
    "$sunstone" render "scenes/$scene/scene.toml" --no-figures --force -o "$work/$scene.zarr"
    "$sunstone" trial "$work/$scene.zarr" polarimetric "${schemes[@]}" --relative-noise 5e-4 --repeat 4 \
        -o "$results/$scene.csv" --curve "$results/$scene.png"
    "$sunstone" trial "$work/$scene.zarr" polarimetric "${few[@]}" --prior "$work/prior.toml" --relative-noise 5e-4 --repeat 4 \
        -o "$results/${scene}_prior.csv" --curve "$results/${scene}_prior.png"
    # Maps of errors with a camera's noise, which follows the light.
    "$sunstone" trial "$work/$scene.zarr" polarimetric --detector validation/camera.toml --figure "$results/${scene}_maps.png" \
        --scheme "$work/drr_25.toml" --scheme "$work/drr_36.toml" --scheme "$work/learned/l-qrpr_16.toml" \
        --scheme "$work/learned/l-qrpr_36.toml" --scheme "$work/drr_p_16.toml" --scheme "$work/learned/l-qrpr-p_8.toml"
done
python3 validation/ellipsometry_figures.py
