"""Fine-tuning: from an exported network to a better one."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from savmap.errors import ModelError, OutputError, SavmapError, SiteError
from savmap.lab import commands
from savmap.lab.commands import network_lines
from savmap.lab.train import plan as plans
from savmap.lab.train import train
from savmap.lab.train.data.dataset import MaskFile, Sample, held_out
from savmap.lab.train.data.sets import read_sets
from savmap.lab.train.measure import Reliability, score_file, score_network
from savmap.lab.train.plan import TrainingPlan, float_model, mapping_of, minutes_of, trained_classes

from .conftest import MODELS, write_dataset


def sample(group: str, number: int = 0) -> Sample:
    labels = MaskFile(Path("m.png"), np.arange(256, dtype=np.uint8))
    return Sample(Path(f"{group}-{number}.jpg"), labels, group, "set")


def test_whole_scenes_are_held_out() -> None:
    samples = [sample(group, number) for group in "abcdefghij" for number in range(20)]
    training, validation = held_out(samples, 0.2)
    assert len(validation) == 40
    assert not {one.group for one in training} & {one.group for one in validation}
    assert held_out(samples[::-1], 0.2)[1] == validation[::-1]
    one_scene = held_out(samples[:10], 0.2)
    assert [one.image.stem for one in one_scene[1]] == ["a-8", "a-9"]
    assert [len(part) for part in held_out([sample("a"), sample("b")], 0.9)] == [1, 1]
    for large, small in ("ab", "ba"):
        uneven = [sample(large, number) for number in range(100)] + [sample(small, number) for number in range(5)]
        assert {one.group for one in held_out(uneven, 0.2)[1]} == {small}
    alike = [sample(group, number) for group in "abc" for number in range(100)]
    assert len(held_out(alike, 0.2)[1]) == 100
    with pytest.raises(OutputError, match="1 labelled pictures are too few"):
        held_out(samples[:1], 0.2)


def test_of_pictures_against_forgetting_every_so_many_are_shown(four_pictures: Path) -> None:
    whole, thinned = (read_sets([four_pictures], ["column", "crossbar"], every=every)[0].samples for every in (1, 3))
    assert len(whole) == 4
    assert [one.image for one in thinned] == [whole[0].image, whole[3].image]


def test_calibration_error_is_how_far_confidence_is_from_being_right() -> None:
    labels = np.array([0, 0, 0, 1] * 25, np.uint8)
    sure = np.tile(np.array([[0.95], [0.05]], np.float32), 100)
    reliability = Reliability()
    reliability.add(sure, labels)
    assert reliability.error == pytest.approx(0.2, abs=1e-6)
    fair, ignored = Reliability(), np.full(100, 255, np.uint8)
    fair.add(np.tile(np.array([[0.75], [0.25]], np.float32), 100), labels)
    fair.add(sure, ignored)
    assert fair.error == pytest.approx(0, abs=1e-6)


def test_a_perfect_and_an_empty_prediction(four_pictures: Path) -> None:
    from savmap.lab.train.data.sets import read_set

    samples = read_set(four_pictures, ["column", "crossbar"]).samples
    truths = iter([one.load()[1] for one in samples])

    def perfect(_: np.ndarray) -> np.ndarray:
        return np.eye(3, dtype=np.float32)[next(truths)].transpose(2, 0, 1)

    score = score_network(perfect, samples, ["column", "crossbar"])
    assert (score.mean, score.calibration_error, score.pictures) == (1, 0, 4)
    nothing = np.stack([np.ones((480, 640)), np.zeros((480, 640)), np.zeros((480, 640))]).astype(np.float32)
    assert score_network(lambda _: nothing, samples, ["column", "crossbar"], limit=2).as_json()["iou"] == {
        "column": 0,
        "crossbar": 0,
    }


def test_a_class_that_a_network_lacks_is_never_seen(four_pictures: Path) -> None:
    from savmap.lab.train.data.sets import read_set

    samples = read_set(four_pictures, ["column", "light"], {"crossbar": "light"}).samples[:1]
    assert score_file(MODELS["lights"], samples, ["column", "light"]).iou["column"] == 0


def test_names_of_classes() -> None:
    assert mapping_of(["pole=column", " a = b "], ["b", "column"]) == {"pole": "column", "a": "b"}
    for wrong in ("pole", "a=b=c", "=b"):
        with pytest.raises(SiteError, match="give THEIRS=OURS"):
            mapping_of([wrong], ["b"])
    with pytest.raises(SiteError, match=r"--class pole=colum: the network has no class colum \(it has column, beam\)"):
        mapping_of(["pole=colum"], ["column", "beam"])


def test_from_nothing_all_classes_of_the_plugins_network() -> None:
    assert trained_classes(("post",), ("post", "post_side"), None) == ("post", "post_side")
    assert trained_classes(("post",), ("post",), Path("a.checkpoint.pt")) == ("post",)


def test_a_file_that_has_the_needed_classes_keeps_its_own() -> None:
    assert trained_classes(("light",), ("light", "light_side"), MODELS["lights"]) == ("light",)


def test_a_file_for_other_classes_gets_the_plugins(tmp_path: Path) -> None:
    assert trained_classes(("post",), ("post",), MODELS["lights"]) == ("post",)
    assert trained_classes(("post",), ("post",), tmp_path / "missing.onnx") == ("post",)


def test_how_long() -> None:
    assert (minutes_of(None, True), minutes_of(None, False), minutes_of(3.5, True)) == (20, 60, 3.5)
    with pytest.raises(SiteError, match="--minutes 0: give more than 0"):
        minutes_of(0.0, False)


def test_what_a_run_begins_with_is_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.lab.train.NEEDED", ())
    for name in ("m.onnx", "m.int8.onnx", "m.checkpoint.pt"):
        plan = TrainingPlan(["column"], [tmp_path], tmp_path / "m.onnx", 1, init=tmp_path / "." / name)
        with pytest.raises(OutputError, match=rf"--init .*{name}: this run would write over it; choose another -o"):
            train(plan)


def test_the_float_network_beside_the_one_in_use(tmp_path: Path) -> None:
    assert float_model(MODELS["lights"].with_name("lights.int8.onnx")) == MODELS["lights"]


def test_without_the_float_network_it_is_said_where_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in an installed wheel, which has the networks in integers alone."""
    integers = tmp_path / "posts.int8.onnx"
    integers.touch()
    monkeypatch.setattr(plans, "load_class", lambda name: SimpleNamespace(model=integers))
    where = r"posts\.onnx: no float32 .*pip download --no-deps --no-binary savmap savmap==\d.* or name it with --init"
    with pytest.raises(SavmapError, match=where) as error:
        plans.plan_of("posts", plans.TrainOptions([tmp_path], tmp_path / "m.onnx", init=plans.SHIPPED))
    assert "\n" not in str(error.value)


def test_options_of_fine_tuning_need_a_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.lab.train.NEEDED", ())
    plan = TrainingPlan(["column"], [tmp_path], tmp_path / "m.onnx", 1, int8=True)
    with pytest.raises(OutputError, match="--held-out and --int8 go with fine-tuning"):
        train(plan)


@pytest.mark.extra("train")
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
class TestWithTorch:
    @pytest.mark.parametrize("name", ["shelves", "lights"])
    def test_the_network_of_a_file_gives_the_files_own_output(self, name: str) -> None:
        from savmap.lab.train.export import load_onnx
        from savmap.lab.train.trainer import predictor
        from savmap.vision.networks.segmenter import Segmenter

        network, history = load_onnx(MODELS[name], Segmenter(MODELS[name]).classes)
        picture = np.random.default_rng(5).integers(0, 255, (480, 640, 3)).astype(np.uint8)
        assert np.allclose(predictor(network)(picture), Segmenter(MODELS[name]).probabilities(picture), atol=1e-4)
        assert "earlier" in history[0]

    def test_other_classes_get_a_new_last_layer_alone(self) -> None:
        import torch

        from savmap.lab.train.export import load_onnx

        one, other = load_onnx(MODELS["lights"], ["light"])[0], load_onnx(MODELS["lights"], ["a", "b"])[0]
        assert other.finish.logits.weight.shape[0] == 12
        assert torch.equal(one.context.near[0].weight, other.context.near[0].weight)

    def test_what_cannot_be_trained_on(self, tmp_path: Path) -> None:
        from savmap.lab.train.export import load_onnx

        (tmp_path / "text.onnx").write_text("no model", encoding="utf-8")
        integers = MODELS["lights"].with_name("lights.int8.onnx")
        for path, words in (
            (tmp_path / "text.onnx", "not an ONNX model"),
            (tmp_path / "none.onnx", "cannot be read"),
            (integers, "has no weights"),
        ):
            with pytest.raises(ModelError, match=f"{path.name}: {words}.* begins from a float32 file"):
                load_onnx(path, ["light"])

    def test_temperature_makes_confidence_honest(self) -> None:
        import torch

        from savmap.lab.train.finetune import softmax, temperature_for, with_temperature
        from savmap.lab.train.network import build

        generator = torch.Generator().manual_seed(0)
        honest = torch.randn(20000, 3, generator=generator) * 2
        labels = torch.multinomial(torch.softmax(honest, 1), 1, generator=generator)[:, 0]
        assert temperature_for(3 * honest, labels) == pytest.approx(3, rel=0.05)
        errors = []
        for divisor in (1.0, 3.0):
            reliability = Reliability()
            reliability.add(softmax(3 * honest / divisor), labels.numpy().astype(np.uint8))
            errors.append(reliability.error)
        assert errors[1] < 0.02 < errors[0]
        network = build(2, None).eval()
        picture = torch.rand(1, 3, 64, 64, generator=generator) * 255
        with torch.inference_mode():
            assert torch.allclose(with_temperature(network, 2.5)(picture), network(picture) / 2.5, atol=1e-5)

    @pytest.mark.usefixtures("quick_export")
    def test_best_network_is_chosen_by_named_sets(
        self, plan: TrainingPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from savmap.lab.train import finetune

        judged: list[set[Path]] = []

        def scored(predict: object, samples: list[Sample], *others: object) -> object:
            judged.append({one.image.parents[1] for one in samples})
            return score_network(lambda image: np.zeros((3, 480, 640), np.float32), samples, plan.classes)

        monkeypatch.setattr(finetune, "score_network", scored)
        chooses = write_dataset(tmp_path / "choice", 2)
        train(replace(plan, choose_by=[chooses]))
        assert judged
        assert all(one == {chooses} for one in judged)

    def test_frozen_is_frozen(self) -> None:
        import torch

        from savmap.lab.train.export import load_onnx
        from savmap.lab.train.trainer import FINE_TUNING, Trainer

        network, _ = load_onnx(MODELS["lights"], ["light"])
        before = {name: value.clone() for name, value in network.state_dict().items()}
        rng = np.random.default_rng(0)
        batch = rng.integers(0, 255, (1, 64, 64, 3)).astype(np.uint8), rng.integers(0, 2, (1, 64, 64)).astype(np.uint8)
        Trainer(network, FINE_TUNING).step(batch, 0.5)
        changed = {name for name, value in network.state_dict().items() if not torch.equal(value, before[name])}
        assert "finish.logits.weight" in changed
        assert "encoder.blocks.5.expand.weight" in changed
        assert not {name for name in changed if name.startswith(("encoder.stem", "encoder.blocks.4."))}
        assert not {name for name in changed if "running" in name}

    def test_before_and_after_and_what_integers_lose(self, plan: TrainingPlan, tmp_path: Path) -> None:
        import onnx

        from savmap.vision.networks.segmenter import Segmenter

        other = write_dataset(tmp_path / "other", 5)
        for path in sorted((other / "images").iterdir())[:4]:
            path.unlink()
        network = train(replace(plan, held_out=[other], int8=True))
        recipe = network.recipe
        assert recipe["steps"] == 2
        assert set(recipe["scores"]) == {"validation", "other"}
        for figures in recipe["scores"].values():
            assert set(figures) == {"before", "after", "int8"}
        text = "\n".join(network_lines(network))
        for words in ("validation (1)", "other (1)", "1 validation pictures are too few", "8-bit integers lose"):
            assert words in text
        assert recipe["calibration"]["temperature"] == 1.0
        assert "--held-out SET" not in text
        alone = recipe | {"scores": {"validation": recipe["scores"]["validation"]}}
        assert "--held-out SET measures on others" in "\n".join(network_lines(replace(network, recipe=alone)))
        for name in ("m.onnx", "m.int8.onnx"):
            written = {entry.key: entry.value for entry in onnx.load(tmp_path / name).metadata_props}
            assert json.loads(written["savmap.recipe"])["scores"] == recipe["scores"]
            assert written["savmap.classes"] == '["upright", "beam"]'
        assert Segmenter(tmp_path / "m.int8.onnx").classes == ("upright", "beam")
        assert {path.name for path in tmp_path.glob("m.*")} == {"m.onnx", "m.int8.onnx", "m.checkpoint.pt"}
        with pytest.raises(OutputError, match="is also trained on, 4 of 4 pictures in all"):
            train(replace(plan, held_out=plan.data))

    @pytest.mark.usefixtures("quick_export")
    def test_enough_validation_pictures_calibrate(
        self, plan: TrainingPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from savmap.lab.train import finetune

        monkeypatch.setattr(finetune, "LEAST_TO_CALIBRATE", 1)
        monkeypatch.setattr(commands, "LEAST_TO_CALIBRATE", 1)
        network = train(plan)
        assert network.recipe["calibration"]["temperature"] != 1.0
        assert "fitted to the validation pictures" in "\n".join(network_lines(network))

    def test_copies_of_pictures_are_not_held_out(self, plan: TrainingPlan, tmp_path: Path) -> None:
        copies = shutil.copytree(plan.data[0], tmp_path / "copies")
        with pytest.raises(OutputError, match=r"--held-out .*copies: a-00000\.jpg is also trained on, 4 of 4"):
            train(replace(plan, held_out=[copies]))
        own = write_dataset(tmp_path / "validation", 5)
        for path in sorted((own / "images").iterdir())[:4]:
            path.unlink()
        with pytest.raises(OutputError, match="two sets would be called validation; rename its folder"):
            train(replace(plan, held_out=[own]))
