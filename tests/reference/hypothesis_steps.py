"""The steps of a compiled search, each asked by itself: ``native.MapSearch`` takes them within itself."""

from __future__ import annotations

from firstfix.engine.candidates import Candidates
from firstfix.engine.hypotheses import HypothesisSearch, _rows
from firstfix.engine.registered_candidate import RegisteredCandidate


class HypothesisSteps(HypothesisSearch):
    """A search whose state can be looked at, and whose later steps can be taken one by one."""

    def align(self, candidates: Candidates) -> None:
        """Align candidates, which a later run ranks."""
        self._search.align(*_rows(candidates))

    @property
    def may_explain_scan(self) -> bool:
        """Whether one of the aligned poses may explain the scan, if nothing passes through the map there."""
        return self._search.may_explain_scan()

    @property
    def is_settled(self) -> bool:
        """Whether the best pose is so surely right that nothing else is searched for."""
        return self._search.is_settled()

    @property
    def explains_scan(self) -> bool:
        """Whether the best pose would be accepted without its rivals, with up surely right."""
        return self._search.explains_scan()

    def is_accepted(self, min_probability: float | None) -> bool:
        """Whether the best pose would be the answer.

        Args:
            min_probability: threshold to use instead of the calibration's own.
        """
        return self._search.is_accepted(min_probability)

    def try_aliases(self, min_probability: float | None, *, nearby: bool) -> list[tuple[str, float]]:
        """Let the known aliases of the best pose compete, and return the seconds of each stage of it.

        Those are registered that were not yet, and could change the answer.

        Args:
            min_probability: as for ``is_accepted``.
            nearby: as for ``run``.
        """
        return self._search.try_aliases(min_probability, nearby)

    def with_look_alikes_marked(self) -> list[RegisteredCandidate]:
        """The distinct poses, with those marked that the scan does not tell from the best one."""
        found = self._search.mark_look_alikes()
        return RegisteredCandidate.found(self._index, self._map_id, self._spots, found)

    def aliases_outside(self) -> Candidates:
        """The known aliases of the best pose that the prior excludes, if the scan may fit them as well."""
        return Candidates(*self._search.aliases_outside())

    def lead_outside(self, anywhere: HypothesisSteps) -> float:
        """Support by which a pose outside the prior is better than the best one in it, or 0.

        Args:
            anywhere: a search without the prior.
        """
        return self._search.lead_outside(anywhere._search)
