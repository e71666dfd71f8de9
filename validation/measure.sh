#!/usr/bin/env bash
# Measures everything anew that README.md and docs/ state, and writes the numbers into them: about a quarter of an hour on 2 cores.
# The machine must be quiet and the tree committed, since every result says of which commit it is.
#
#     validation/measure.sh             all that is measured in seconds, and the cross-check
#     validation/measure.sh speed rays  these alone
#     validation/measure.sh figures     the tables of rotating ellipsometry (ten minutes more)
set -euo pipefail
cd "$(dirname "$0")/.."
read -r load _ </proc/loadavg
if [ -z "${BUSY:-}" ] && awk "BEGIN { exit !($load > 1) }"; then
    echo "the machine is busy (load $load): times would be too long; BUSY=1 measures nevertheless" >&2
    exit 2
fi
cargo build --release --locked
cargo bench --bench rays --no-run
unset SUNSTONE

measure() {
    echo "== $1"
    case $1 in
    speed) python3 validation/speed.py --record ;;
    rays) python3 validation/rays.py --rounds 5 --record ;;
    epipolar) python3 validation/epipolar.py --patterns 16 --record ;;
    convergence) python3 validation/convergence.py --seconds 10 --record ;;
    crosscheck) python3 validation/crosscheck.py --record ;;
    equal_error) python3 validation/equal_error.py --record ;;
    decompose) python3 validation/decompose.py --record ;;
    ellipsometry) python3 validation/ellipsometry.py --record ;;
    learning) python3 validation/learning.py --record ;;
    figures) validation/ellipsometry_figures.sh ;;
    *) echo "there is no part $1; see the head of $0" >&2 && exit 2 ;;
    esac
}

if [ -n "$(git status --porcelain -- src Cargo.toml Cargo.lock scenes validation/*.py validation/*.sh)" ]; then
    echo "the tree has changes: commit first, so that the results can say what they are of" >&2
    exit 2
fi
begun=$SECONDS failed=()
for part in "${@:-speed rays epipolar convergence equal_error decompose ellipsometry learning crosscheck}"; do
    # Without arguments the default is one word of many.
    for one in $part; do
        # A bar that is missed leaves its numbers, which must be seen too.
        measure "$one" || failed+=("$one")
    done
done
echo "== $((SECONDS - begun)) s"
python3 validation/readme.py --write || failed+=(readme)
[ ${#failed[@]} = 0 ] || { echo "not as it should be: ${failed[*]}" >&2; exit 1; }
