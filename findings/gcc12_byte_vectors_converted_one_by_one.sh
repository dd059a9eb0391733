#!/usr/bin/env bash
# GCC 12: __builtin_convertvector of 16 bytes to 16 ints is compiled byte by byte, at -O3 and for AVX-512 too.
#
# Version: g++-12 12.2.0-14+deb12u1 (Debian 12), x86-64, on a machine with Debian 12's binutils.
# Behaviour: the conversion becomes 16 single loads (movzbl) and the joining of their results, though the processor has one
# instruction for it (vpmovzxbd), and conversions of ints to floats are one instruction. A plain loop over the bytes, which
# the vectoriser takes, has no single load.
# Who writes vectors by hand to be quick reads codes of 8 bits at a third of the speed of the loop that they replace.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
(cd "$folder" && apt-get -qq -o APT::Sandbox::User= download {cpp-12,gcc-12,g++-12,libgcc-12-dev}=12.2.0-14+deb12u1)
for package in "$folder"/*.deb; do dpkg -x "$package" "$folder/gcc"; done
cat >"$folder/convert.cpp" <<'CODE'
typedef unsigned char Bytes __attribute__((vector_size(16)));
typedef int Ints __attribute__((vector_size(64)));
extern "C" void by_vector(const Bytes* from, Ints* to) { *to = __builtin_convertvector(*from, Ints); }
extern "C" void by_loop(const unsigned char* __restrict from, int* __restrict to) {
  for (int i = 0; i < 16; ++i) to[i] = from[i];
}
CODE
for machine in x86-64-v3 x86-64-v4; do
  "$folder/gcc/usr/bin/g++-12" -O3 -march=$machine -S -o "$folder/convert.s" "$folder/convert.cpp"
  awk -v machine=$machine '/^by_/ { name = $1 } name != "" { single[name] += /movzbl/ }
    END { for (name in single) print machine, name, single[name], "single loads" }' "$folder/convert.s"
done | sort | tee "$folder/found"
[ "$(grep -c 'by_vector: 16 single' "$folder/found")" = 2 ] && [ "$(grep -c 'by_loop: 0 single' "$folder/found")" = 2 ] \
  || { echo "the behaviour has changed"; exit 1; }
