"""Evaluates jobs on Ray actors, of a local Ray or of a cluster."""

from ibrid.errors import IbridError
from ibrid_search.evaluation.crew import PATIENCE, Assessor, CrewEvaluator
from ibrid_search.evaluation.ray_session import open_session
from ibrid_search.evaluation.remote_worker import Hiring


class RayEvaluator(CrewEvaluator[Assessor]):
    """A `CrewEvaluator` of actors, each with one core, of a local Ray or of the cluster at `address`.

    Raises IbridError when Ray is missing, does not start or does not answer, or the assessor cannot travel.
    """

    def __init__(
        self,
        assessor: Assessor,
        workers: int,
        *,
        address: str | None = None,
        wall: float = 60.0,
        lost: int = 3,
        patience: float = PATIENCE,
    ):
        if workers < 1 or lost < 1 or not wall > 0:
            raise IbridError(
                f"workers and lost must be 1 or more and wall above 0 s, found {workers}, {lost} and {wall:g} s"
            )
        self._session = open_session(workers, address)
        try:
            hiring = Hiring(self._session.ray, assessor, wall)
        except BaseException:
            self._session.close()
            raise
        super().__init__(
            assessor, workers, hiring.hire, wall=wall, lost=lost, patience=patience, leave=self._session.close
        )
