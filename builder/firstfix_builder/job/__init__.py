"""One build as a job: fetches its sources, reports and logs its progress."""
