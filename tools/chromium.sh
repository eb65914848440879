#!/usr/bin/env bash
# Install Chromium, in which the pages are tested, by apt where this user may; without it those tests are skipped.
set -euo pipefail

if command -v chromium > /dev/null || command -v google-chrome > /dev/null; then
  exit 0
elif [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
  apt-get update --quiet --quiet
  apt-get install --yes --quiet --no-install-recommends chromium || echo "chromium: apt has no chromium"
else
  echo "chromium is not installed: apt-get install chromium"
fi
