"""One build as a job: its sources fetched, its progress reported and logged."""
