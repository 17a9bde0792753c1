"""What `ibrid policy train` does without `--from`: makes the policy anew and says how good it
is.
"""

import os
from argparse import Namespace

from ibrid_search.evaluation.ray_session import open_session
from ibrid_search.settings import Workers

from ibrid_policy.experience.shards import Processes, RayCluster
from ibrid_policy.making import Order, train_policy
from ibrid_policy.training import TrainingSettings


def train(arguments: Namespace) -> int:
    """Train, with the options of the command."""
    asked = (os.cpu_count() or 1) if arguments.workers is None else arguments.workers
    workers = Workers(asked, arguments.ray).number
    training = TrainingSettings(steps=arguments.steps, seed=arguments.seed)
    order = Order(arguments.inverters, arguments.seed, training, arguments.size)
    session = None if arguments.ray is None else open_session(workers, arguments.ray)
    try:
        crew = Processes(workers) if session is None else RayCluster()
        found = train_policy(arguments.out, order, crew=crew, resume=arguments.resume)
    except KeyboardInterrupt:
        again = f"ibrid policy train --out {arguments.out} --resume (and the same options)"
        raise KeyboardInterrupt(f"stopped; go on with: {again}") from None
    finally:
        if session is not None:
            session.close()
    print(
        f"\n{'never trained on':<30} {'questions':>9} {'valid':>6} {'exact':>6} {'of 4':>6} "
        f"{'-ln p':>6}"
    )
    for name, one in found.items():
        shares = (
            " ".join(f"{share:>6.0%}" for share in (one.valid, one.exact, one.exact_of_several))
            if one.questions
            else ""
        )
        print(
            f"{name:<30} {one.questions:>9} {shares} {one.loss:>6.2f}"
            if one.questions
            else f"{name:<30} {0:>9}"
        )
    print(f"\n{arguments.out}: model.safetensors, config.json, vocabulary.json, MODEL_CARD.md")
    return 0
