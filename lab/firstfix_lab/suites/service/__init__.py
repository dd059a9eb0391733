"""The running service under load: throughput, what HTTP costs, replicas that come and go, many maps."""
