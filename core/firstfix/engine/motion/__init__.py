"""Motion of the sensor during a scan: it is solved where the times of the scan's points are known."""
