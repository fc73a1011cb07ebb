#!/bin/sh
# Runs every finding: a small program that shows what a public package does where one would expect
# something else. Each works in a temporary folder with that package alone, from the index, and
# fails once the package does otherwise. No part of the tests, since it needs a network.
set -eu
cd "$(dirname "$0")"
failed=0
for finding in *.sh; do
  [ "$finding" = run.sh ] && continue
  echo "== $finding"
  sh "$finding" || { echo "== $finding: no longer so"; failed=1; }
done
exit "$failed"
