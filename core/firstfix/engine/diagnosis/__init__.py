"""Why a scan is not localized, or what is odd about it: the findings of an answer."""
