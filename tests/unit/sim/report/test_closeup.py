from __future__ import annotations

import numpy as np
import trimesh

from sim.report.closeup import Camera, Mesh, around, closeup, direction, draw, first_seen_from, png_of


def ball(radius: float = 5.0) -> Mesh:
    made = trimesh.creation.icosphere(4, radius)
    return np.asarray(made.vertices), np.asarray(made.faces, dtype=np.int64), np.zeros(len(made.vertices))


def test_camera_puts_its_centre_in_the_middle_and_keeps_millimetres() -> None:
    rng = np.random.default_rng(1)
    for towards in (direction(0.3, 0.6), direction(-2.0, 1.4), np.array([0.0, 0.0, 1.0])):
        centre = rng.normal(size=3)
        camera = Camera(centre, towards, 10.0, 200, 100)
        assert np.allclose(camera.project(centre[None]), [[100.0, 50.0, 0.0]])
        points = centre + rng.normal(size=(20, 3))
        seen = camera.project(points) / [10.0, 10.0, 1.0]
        lengths = np.linalg.norm(points[:, None] - points[None], axis=2)
        assert np.allclose(np.linalg.norm(seen[:, None] - seen[None], axis=2), lengths)
        assert np.allclose(np.cross(camera.right, camera.up), camera.towards)


def test_place_on_a_ball_is_looked_at_from_its_own_side() -> None:
    for normal in (direction(3.5, 0.3), direction(1.0, 0.5), direction(-1.0, 1.3)):
        assert first_seen_from(ball(), 5.0 * normal) @ normal > 0.0


def test_metal_farther_than_the_reach_is_left_out_and_what_stays_is_unchanged() -> None:
    at = np.array([5.0, 0.0, 0.0])
    vertices, facets, _ = around(ball(), at, 2.0)
    assert len(facets) > 0 and np.linalg.norm(vertices - at, axis=1).max() < 2.0
    assert np.allclose(np.linalg.norm(vertices, axis=1), 5.0) and facets.max() == len(vertices) - 1


def test_ball_is_drawn_as_a_disc_of_its_size() -> None:
    image = draw(ball(), Camera(np.zeros(3), direction(0.4, 0.4), 20.0, 400, 300), 0.3)
    drawn = (np.abs(image - image[0, 0]) > 1e-3).any(axis=2)
    assert image.shape == (150, 200, 3) and abs(drawn.sum() - np.pi * 50.0**2) < 0.02 * np.pi * 50.0**2


def test_picture_holds_pixels_and_no_word_of_what_made_it() -> None:
    image = np.linspace(0.0, 1.0, 30).reshape(2, 5, 3)
    data = png_of(image)
    assert data == png_of(image) and data.startswith(b"\x89PNG") and b"tEXt" not in data and b"tIME" not in data


def test_place_without_metal_says_so() -> None:
    words = str(closeup(ball(), np.array([200.0, 0.0, 0.0]), [], np.zeros((0, 3)), 0.3, "far away"))
    assert "no metal stands here" in words
