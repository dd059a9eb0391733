"""Arithmetic that the C++ library repeats to the last bit: angles, eigenvectors, samples."""
