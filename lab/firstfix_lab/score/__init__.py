"""The yardstick: scores the answers of any system by docs/benchmark-protocol.md."""
