#!/usr/bin/env bash
# GCC 12: double -> float -> double of two numbers beside each other is left out from -O2 on.
#
# Version: g++-12 12.2.0-14+deb12u1 (Debian 12), x86-64, on a machine with Debian 12's libc6-dev and binutils; no option that
# permits it, such as -ffast-math, is given.
# Behaviour: the pass that joins statements to vectors (SLP) makes the narrowing and the widening of two doubles one vector
# conversion each, and then drops both. Of three numbers that a loop rounds, the first two keep all their digits and the third
# is rounded. -O1 and -fno-tree-slp-vectorize are right.
# Who rounds a direction to the precision in which it is sent gets another one than the reader of the message. A volatile float
# between the two conversions helps.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
(cd "$folder" && apt-get -qq -o APT::Sandbox::User= download {cpp-12,gcc-12,g++-12,libgcc-12-dev,libstdc++-12-dev}=12.2.0-14+deb12u1)
for package in "$folder"/*.deb; do dpkg -x "$package" "$folder/gcc"; done
cat >"$folder/round.cpp" <<'CODE'
#include <array>
#include <cstdio>
using Direction = std::array<double, 3>;
__attribute__((noinline)) Direction rounded(Direction up) {
  for (double& v : up) v = static_cast<double>(static_cast<float>(v));
  return up;
}
int main(int count, char**) {
  const double third = 1.0 / (2.0 + count);
  for (const double v : rounded({third, third, third})) std::printf(" %s", v == third ? "not rounded," : "rounded,");
}
CODE
for options in -O1 "-O2 -fno-tree-slp-vectorize" -O2 -O3; do
  # shellcheck disable=SC2086
  "$folder/gcc/usr/bin/g++-12" -std=c++17 $options "$folder/round.cpp" -o "$folder/round"
  printf '%s:%s\n' "$options" "$("$folder/round")"
done | tee "$folder/found"
grep -q '^-O2: not rounded' "$folder/found" || { echo "the behaviour has changed"; exit 1; }
