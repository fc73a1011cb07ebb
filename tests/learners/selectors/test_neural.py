"""Neural selectors: symmetric by construction, exact gradients, calibrated, repeatable, and no file
is trusted.
"""

import itertools
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import ListedScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.learners.selectors.network import (
    Architecture,
    BoxNetwork,
    Epochs,
    Mirror,
    SceneTensors,
    pinball,
    read_tensors,
    write_tensors,
)
from stancekit.learners.selectors.neural import (
    FORMAT,
    STEP,
    STEPS,
    NeuralSelector,
    NeuralSettings,
    TrainingRows,
    calibrated_room,
    fit_neural,
    margins,
    roomiest,
    roomy,
)
from stancekit.learners.selectors.selector import quantile_box
from stancekit.learners.training.loop import Checkpoint, run
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick, WithoutMoment
from stancekit.planners.terrain import Patch
from tests.refusals import refuses

SMALL = Architecture(width=32, layers=2, heads=2, corner_width=16)
QUICK = NeuralSettings(
    architecture=SMALL, epochs=2, batch=32, margin_epochs=2, margin_batch=16, seed=3
)


@pytest.fixture(scope="module")
def dataset(labelled: Callable[..., Dataset]) -> Dataset:
    return labelled(400, 40, 31)


@pytest.fixture(scope="module")
def selector(dataset: Dataset) -> NeuralSelector:
    return fit_neural(dataset, QUICK)


def drawn(name: str, count: int, seed: int = 0) -> list[Problem]:
    rng = np.random.default_rng(seed)
    return [distribution(name).sample(rng) for _ in range(count)]


def tensors_of(problems: list[Problem]) -> SceneTensors:
    return SceneTensors.of_problems([Scaled.of(problem) for problem in problems])


def random_network(problems: list[Problem], seed: int = 0) -> BoxNetwork:
    torch.manual_seed(seed)
    scenes = tensors_of(problems)
    return BoxNetwork.of_data(SMALL, scenes, torch.randn(len(problems), *scenes.reach.shape[1:], 6))


def turned_round(problem: Problem) -> Problem:
    """The problem seen in a mirror across the plane x = 0, written down anew from its patches."""
    x = np.array([-1.0, 1.0, 1.0])
    contacts = []
    for contact in problem.contacts:
        patch = Patch(
            vertices_m=(contact.patch.vertices_m * x)[::-1],
            normal=contact.patch.normal * x,
            shear_reference=contact.patch.shear_reference,
            friction=contact.patch.friction,
        )
        leg = contact.leg.translate(str.maketrans("FR", "RF"))
        leg = contact.leg[0] + leg[1] if contact.leg[1] in "FR" else contact.leg
        contacts.append(
            Contact(
                leg=leg,
                shoulder_m=contact.shoulder_m * x,
                reach_m=contact.reach_m,
                patch=patch,
                force_min=contact.force_min,
                force_max=contact.force_max,
            )
        )
    return problem.posture_with(contacts=tuple(contacts))


@pytest.mark.parametrize("name", ["wall-3", "wall-5"])
def test_boxes_follow_the_order_of_contacts_and_not_that_of_corners(name: str) -> None:
    scenes = tensors_of(drawn(name, 5))
    network = random_network(drawn(name, 40, seed=1))
    low, high, point = network(scenes)
    assert bool((low < high).all() and (low <= point).all() and (point <= high).all())
    count = scenes.reach.shape[1]
    for order in itertools.islice(itertools.permutations(range(count)), 1, 8):
        index = torch.tensor(order)
        moved = replace(scenes, **{k: v[:, index] for k, v in vars(scenes).items()})
        for side, expected in zip(network(moved), (low, high, point), strict=True):
            torch.testing.assert_close(side, expected[:, index], rtol=0.0, atol=1e-5)
    for corners in itertools.permutations(range(3)):
        shuffled = replace(scenes, vertices=scenes.vertices[:, :, torch.tensor(corners)])
        torch.testing.assert_close(network(shuffled)[0], low, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("name", ["ground-3", "wall-3", "wall-5"])
def test_the_mirror_is_an_exact_symmetry_of_scenes_and_of_p1(name: str) -> None:
    problems = drawn(name, 60)
    mirror = Mirror.of(tensors_of(problems))
    assert mirror is not None
    originals = [Scaled.of(problem) for problem in problems[:12]]
    turned = [Scaled.of(turned_round(problem)) for problem in problems[:12]]
    flipped = torch.ones(12, dtype=torch.bool)
    shown, written = (
        mirror.scenes(tensors_of(problems[:12]), flipped),
        SceneTensors.of_problems(turned),
    )
    for key in ("frames", "friction", "shoulders", "reach"):
        torch.testing.assert_close(getattr(shown, key), getattr(written, key), rtol=0.0, atol=1e-6)
    torch.testing.assert_close(shown.vertices, written.vertices.flip(2), rtol=0.0, atol=1e-6)
    rng, programs = np.random.default_rng(2), Programs()
    force = np.tile([0.4, 0.0, 0.2], (originals[0].size[0], 1))
    middle = np.stack([np.hstack([problem.patches.mean(axis=1), force]) for problem in originals])
    low = torch.tensor(middle - rng.uniform(0.05, 0.3, middle.shape))
    high = torch.tensor(middle + rng.uniform(0.05, 0.3, middle.shape))
    here, there = (
        margins(low, high, originals, programs),
        margins(*mirror.boxes((low, high, low), flipped)[:2], turned, programs),
    )
    assert bool((here != 0.0).sum() > 6)
    torch.testing.assert_close(here, there, rtol=0.0, atol=1e-6)


def test_limbs_that_lie_uneven_have_no_mirror() -> None:
    scenes = tensors_of(drawn("wall-3", 3))
    moved = scenes.shoulders + torch.tensor([0.05, 0.0, 0.0])
    assert Mirror.of(replace(scenes, shoulders=moved)) is None


def test_the_margin_flows_back_as_finite_differences_say(
    dataset: Dataset, programs: Programs
) -> None:
    problems = [Scaled.of(problem) for problem in dataset.select(dataset.infeasible[:6]).problems()]
    box = quantile_box(dataset.points)
    low, high = (
        torch.tensor(np.stack([side] * 6)).requires_grad_() for side in (box.low, box.high)
    )
    weights = torch.arange(1.0, 7.0, dtype=torch.float64)
    torch.autograd.backward((weights * margins(low, high, problems, programs)).sum())
    assert low.grad is not None
    assert high.grad is not None
    rng, step = np.random.default_rng(0), 1e-5
    for _ in range(3):
        ways = [torch.tensor(rng.normal(size=low.shape)) for _ in range(2)]
        sides = [(low.detach() + s * ways[0], high.detach() + s * ways[1]) for s in (step, -step)]
        ahead, behind = (
            float((weights * margins(*pair, problems, programs)).sum()) for pair in sides
        )
        along = float((low.grad * ways[0]).sum() + (high.grad * ways[1]).sum())
        assert along == pytest.approx((ahead - behind) / (2 * step), rel=0.02, abs=2e-3)


def test_the_pinball_loss_is_least_at_the_quantiles() -> None:
    points = torch.tensor(np.random.default_rng(0).normal(size=(501, 1, 6)))
    best = torch.quantile(points, 0.1, dim=0), torch.quantile(points, 0.9, dim=0)

    def loss(low: torch.Tensor, high: torch.Tensor) -> float:
        return float(pinball(low.expand_as(points), high.expand_as(points), points, 0.1).mean())

    for shift in (-0.05, 0.05):
        assert loss(*best) < min(loss(best[0] + shift, best[1]), loss(best[0], best[1] + shift))


def test_calibration_gives_no_more_room_than_the_target_needs(
    dataset: Dataset, programs: Programs
) -> None:
    rows = TrainingRows.of(dataset.select(dataset.feasible[:60]), "feasible")
    network = random_network(drawn("wall-3", 40))
    room = calibrated_room(
        network, rows, programs, NeuralSettings(target=0.8), least=-0.05, most=0.5
    )

    def is_feasible(room: float) -> int:
        with torch.no_grad():
            low, high, _ = (side.numpy().astype(float) for side in network(rows.scenes))
        return sum(
            programs.get(McCormick, problem.layout)
            .solve(problem, roomy(low[i], high[i], room))
            .feasible
            for i, problem in enumerate(rows.problems)
        )

    assert is_feasible(room) >= 48 > is_feasible(room - 1e-3)


def test_more_room_is_given_where_that_costs_fewer_mistakes(
    dataset: Dataset, programs: Programs
) -> None:
    both = tuple(
        TrainingRows.of(dataset.select(each[:20]), label)
        for each, label in ((dataset.feasible, "feasible"), (dataset.infeasible, "infeasible"))
    )
    network = random_network(drawn("wall-3", 40))
    settings = NeuralSettings(caution=2.0)
    rooms = (0.12 + STEP * np.arange(STEPS + 1)).tolist()

    def cost(room: float) -> float:
        """All rows solved anew."""
        wrong = []
        for rows in both:
            with torch.no_grad():
                low, high, _ = (side.numpy().astype(float) for side in network(rows.scenes))
            wrong.append(
                np.mean(
                    [
                        programs.get(McCormick, problem.layout)
                        .solve(problem, roomy(low[i], high[i], room))
                        .feasible
                        for i, problem in enumerate(rows.problems)
                    ]
                )
            )
        return 2.0 * (1.0 - wrong[0]) + wrong[1]

    costs = [cost(room) for room in rooms]
    assert max(costs) > min(costs) + 0.01
    room = roomiest(network, both, programs, settings, least=0.12)
    assert costs[rooms.index(room)] == pytest.approx(min(costs), abs=1e-9)


def test_training_repeats_to_the_last_bit_and_goes_on_where_it_stopped(
    dataset: Dataset, tmp_path: Path
) -> None:
    few = dataset.select(np.concatenate([dataset.feasible[:60], dataset.infeasible[:20]]))

    class Stop(Exception):
        pass

    def stop_after(epochs: int):  # type: ignore[no-untyped-def]
        def on_progress(done: int, total: int) -> None:
            assert total == 4
            if done == epochs:
                raise Stop

        return on_progress

    for epochs in (1, 3):
        with pytest.raises(Stop):
            fit_neural(few, QUICK, stop_after(epochs), checkpoint=tmp_path / "checkpoint")
    resumed = fit_neural(few, QUICK, checkpoint=tmp_path / "checkpoint")
    fit_neural(few, QUICK).save(tmp_path / "straight")
    resumed.save(tmp_path / "resumed")
    assert (tmp_path / "straight").read_bytes() == (tmp_path / "resumed").read_bytes()
    assert [record["stage"] for record in resumed.provenance["history"]] == [1, 1, 2, 2]
    with refuses():
        fit_neural(few, replace(QUICK, seed=4), checkpoint=tmp_path / "checkpoint")


def test_a_trained_network_knows_more_than_the_quantile_box(dataset: Dataset) -> None:
    train, held = dataset.split((0.8, 0.2))
    settings = replace(QUICK, epochs=28, margin_epochs=0)
    network = fit_neural(train, settings, calibration=held).network
    rows = TrainingRows.of(held, "feasible")
    box = quantile_box(train.points)
    fixed = [
        torch.tensor(side, dtype=torch.float32).expand_as(rows.points)
        for side in (box.low, box.high)
    ]
    with torch.no_grad():
        low, high, _ = network(rows.scenes)
    learned, plain = (
        float(pinball(*pair, rows.points, 0.05).mean()) for pair in ((low, high), fixed)
    )
    assert learned < 0.6 * plain


def test_predictions_are_actions_single_or_in_a_batch(
    dataset: Dataset, selector: NeuralSelector
) -> None:
    env = EnvelopeSelectionEnv("wall-3", scenes=ListedScenes(scenes_of(dataset)[:4]))
    observations = [env.reset(seed=0)[0] for _ in range(4)]
    actions = [selector.predict(observation)[0] for observation in observations]
    batch, state = selector.predict(
        {k: np.stack([o[k] for o in observations]) for k in observations[0]}, state="kept"
    )
    assert state == "kept"
    np.testing.assert_allclose(batch, actions, rtol=0.0, atol=1e-5)
    assert all(env.action_space.contains(action) for action in actions)
    assert env.step(actions[-1])[4]["log_volume"] > -np.inf
    problems = [Scaled.of(scene.problem) for scene in scenes_of(dataset)[:4]]
    for box, action in zip(selector.envelopes(problems), actions, strict=True):
        np.testing.assert_allclose(
            box.to_vector(), Envelope.from_vector(action).to_vector(), atol=1e-5
        )
    five, _ = EnvelopeSelectionEnv("wall-5").reset(seed=0)
    with refuses("observation 'vertices'"):
        selector.predict(five)


def test_a_saved_selector_comes_back_the_same(selector: NeuralSelector, tmp_path: Path) -> None:
    selector.save(tmp_path / "a.safetensors")
    back = NeuralSelector.load(tmp_path / "a.safetensors")
    back.save(tmp_path / "b.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    observation, _ = EnvelopeSelectionEnv("wall-3").reset(seed=1)
    np.testing.assert_array_equal(selector.predict(observation)[0], back.predict(observation)[0])
    header, _ = read_tensors(tmp_path / "a.safetensors", "stancekit/neural/1")
    assert header["calibration"]["room"] == selector.room
    assert header["provenance"]["method"] == "neural"


def test_weights_in_half_precision_take_half_the_room_and_move_no_box_by_a_hundredth(
    dataset: Dataset, selector: NeuralSelector, tmp_path: Path
) -> None:
    whole, half = tmp_path / "whole", tmp_path / "half"
    selector.save(whole)
    selector.save(half, half=True)
    assert half.stat().st_size < 0.6 * whole.stat().st_size
    again = NeuralSelector.load(half)
    rounded = {name: each.half().float() for name, each in selector.network.state_dict().items()}
    assert all(
        torch.equal(each, rounded[name]) for name, each in again.network.state_dict().items()
    )
    problems = [Scaled.of(problem) for problem in dataset.problems()]
    for mine, theirs in zip(selector.envelopes(problems), again.envelopes(problems), strict=True):
        np.testing.assert_allclose(mine.low, theirs.low, atol=1e-2)
        np.testing.assert_allclose(mine.high, theirs.high, atol=1e-2)
    again.save(whole, half=True)
    assert whole.read_bytes() == half.read_bytes()


def test_files_that_are_not_this_selector_are_refused_in_one_line(
    selector: NeuralSelector, tmp_path: Path
) -> None:
    good, path = tmp_path / "good", tmp_path / "odd"
    selector.save(good)
    header, tensors = read_tensors(good, FORMAT)
    for content in (good.read_bytes()[:-5], pickle.dumps({"a": 1}), b""):
        path.write_bytes(content)
        with refuses("odd"):
            NeuralSelector.load(path)
    three = header | {"architecture": header["architecture"] | {"heads": 3}}
    for name, written in (
        ("format", ("someone/else", header, tensors)),
        ("more", (FORMAT, {**header, "more": 1}, tensors)),
        ("scale", (FORMAT, header, {**tensors, "scale": torch.full((6,), torch.nan)})),
        ("scale", (FORMAT, header, {**tensors, "scale": torch.ones(5)})),
        ("architecture.width", (FORMAT, three, tensors)),
    ):
        write_tensors(path, *written)
        with refuses("odd", name):
            NeuralSelector.load(path)


def test_settings_out_of_range_are_refused() -> None:
    for name, value in (
        ("epochs", 0),
        ("margin_epochs", -1),
        ("target", 1.0),
        ("softness", 0.0),
        ("share", 0.0),
    ):
        with refuses(name):
            NeuralSettings(**{name: value})
    with refuses("width"):
        Architecture(width=32, heads=3)


def some(name: str, count: int, *, with_margin: bool = True) -> list[Scaled]:
    """Problems of which P̄ has an answer, so that P1 has a margin; or those of which it has
    none.
    """
    rng, programs, found = np.random.default_rng(3), Programs(), list[Scaled]()
    while len(found) < count:
        problem = Scaled.of(distribution(name).sample(rng))
        answered = programs.get(WithoutMoment, problem.layout).solve(problem) is not None
        found += [problem] if answered == with_margin else []
    return found


def boxes(problems: list[Scaled], seed: int = 0) -> list[torch.Tensor]:
    """Boxes of some width about the patches' middles, in double precision."""
    rng, out = np.random.default_rng(seed), []
    for problem in problems:
        middle = np.hstack(
            [problem.patches.mean(axis=1), np.full((problem.size[0], 3), [0.4, 0.0, 0.2])]
        )
        width = rng.uniform(0.05, 0.25, (2, *middle.shape))
        out.append(np.stack([middle - width[0], middle + width[1]]))
    low, high = np.stack(out, axis=1)
    return [torch.tensor(side, requires_grad=True) for side in (low, high)]


@pytest.mark.parametrize(
    ("name", "relaxation"), [("wall-3", "p1"), ("wall-3", "joint"), ("ground-3", "p1")]
)
def test_the_gradient_is_that_of_finite_differences(name: str, relaxation: str) -> None:
    problems, programs = some(name, 2), Programs()
    sides = boxes(problems)
    assert bool((margins(*sides, problems, programs, relaxation).abs() > 1e-4).all())
    assert torch.autograd.gradcheck(
        lambda low, high: margins(low, high, problems, programs, relaxation),
        sides,
        eps=1e-4,
        atol=1e-4,
        rtol=1e-3,
    )


def test_a_batch_is_its_scenes_one_by_one_in_the_precision_of_the_boxes() -> None:
    problems, programs = some("wall-5", 3), Programs()
    low, high = (side.detach() for side in boxes(problems))
    found = margins(low, high, problems)
    assert found.dtype == torch.float64
    for k, problem in enumerate(problems):
        box = Envelope(low=low[k].numpy(), high=high[k].numpy())
        assert float(found[k]) == McCormick.margin(programs, problem, box).margin
    assert margins(low.float(), high.float(), problems).dtype == torch.float32


def test_where_there_is_no_margin_nothing_flows_back() -> None:
    problems = some("wall-3", 1, with_margin=False)
    low, high = boxes(problems)
    found = margins(low, high, problems)
    torch.autograd.backward(found.sum())
    assert float(found[0].detach()) == 0.0
    assert not bool(low.grad.any())


def test_boxes_of_another_number_of_scenes_or_contacts_are_refused() -> None:
    problems = some("wall-3", 2)
    low, high = boxes(problems)
    with refuses("low", "high"):
        margins(low[:1], high, problems)
    with refuses("low", "high"):
        margins(high, low, problems)


def test_a_rate_that_would_rise_in_no_time_rises_in_a_step() -> None:
    """Nine steps, of which a tenth of ten is one, at which the schedule begins."""
    network, rows = torch.nn.Linear(1, 1), torch.zeros(9, 1)
    chance = torch.Generator().manual_seed(0)
    loss = lambda part: network(rows[part]).square().mean()  # noqa: E731
    fit = Epochs(network, loss, 9, chance, epochs=1, batch=1, rate=1e-3, decay=0.0, warm=0.1)
    assert run(fit) == [{}]


def test_epochs_that_were_stopped_end_as_those_that_were_not(tmp_path: Path) -> None:
    rows, kept = torch.arange(9.0)[:, None], Checkpoint(path=tmp_path / "kept.npz", about={})

    def made(epochs: int) -> Epochs:
        torch.manual_seed(0)
        network, chance = torch.nn.Linear(1, 1), torch.Generator().manual_seed(0)
        loss = lambda part: (network(rows[part]) - rows[part]).square().mean()  # noqa: E731
        fit = Epochs(network, loss, 9, chance, epochs=3, batch=2, rate=0.1, decay=0.0, warm=0.3)
        fit.total = epochs
        return fit

    stopped, resumed, whole = made(2), made(3), made(3)
    for fit, checkpoint in ((stopped, kept), (resumed, kept), (whole, None)):
        run(fit, None, checkpoint)
    for name, value in whole.state().items():
        np.testing.assert_array_equal(resumed.state()[name], value)
