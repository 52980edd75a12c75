"""The page on an arm that a person pushes: what it shows and what its buttons do."""

from __future__ import annotations

import io
import socket
import sys
import threading
import urllib.request
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from PIL import Image

from stiction_envs.envs.render.push_page import HOST, PushPage
from stiction_envs.errors import StictionError

pytest.importorskip("viser")


@pytest.fixture
def page(view):
    page = PushPage(view, 0)
    yield page
    page.close()


def nodes(page):
    return page._server.scene._handle_from_node_name


def buttons(page):
    return {h.label: h for h in page._server.gui._gui_input_handle_from_uuid.values()}


def click(page, label, value=None):
    handle = buttons(page)[label]
    for callback in handle._impl.update_cb:
        callback(SimpleNamespace(target=SimpleNamespace(value=value)))


def test_it_serves_its_client_itself_to_this_machine_alone(page):
    text = urllib.request.urlopen(page.url, timeout=5).read().decode()
    assert "<html" in text
    assert 'src="http' not in text
    assert page._server.get_host() == HOST == "127.0.0.1"


def test_every_geom_of_the_arm_is_where_mujoco_has_it(page):
    scene, found = page.view, nodes(page)
    model, data = scene.model, scene.data
    shown = [g for g in range(1, model.ngeom) if model.geom_group[g] < 3]
    assert len(shown) > 30
    for g in shown:
        body = model.geom_bodyid[g]
        frame, node = found[f"/{body}"], found[f"/{body}/{g}"]
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, np.array(frame.wxyz))
        place = frame.position + rotation.reshape(3, 3) @ node.position
        np.testing.assert_allclose(place, data.geom_xpos[g], atol=1e-6)


def test_lines_have_the_colours_of_the_window(page):
    """Viser takes those of lines as linear, and so they are sent."""
    lines = [h for n, h in nodes(page).items() if n.startswith("/marks/")]
    sent = {tuple(int(x) for x in c) for h in lines for c in h.colors.reshape(-1, 3)}
    marks = page._marks.geoms[: page._marks.ngeom]
    drawn = {tuple(np.rint(255 * g.rgba[:3] ** 2.2).astype(int).tolist()) for g in marks}
    assert sent <= drawn
    assert len(sent) >= 3


def test_buttons_push_a_joint_and_the_arm_on_the_page_moves(page, view):
    click(page, "joint", "7")
    for _ in range(15):
        click(page, "push", "+ 10 %")
    click(page, "push", "− 10 %")
    click(page, "Dither on or off")
    before = nodes(page)["/8"].wxyz.copy()
    said = []
    threading.Timer(1.5, lambda: setattr(page, "_open", False)).start()
    page.run(said.append)
    push = view.push
    assert push.joint == 7
    # friction at the rest pose, which the arm has left a little
    assert push.target == pytest.approx(1.4 * push.holds_up_to(1.0), rel=1e-3)
    assert push.dithered
    assert said[:2] == [f"{page.url} shows the arm, until Ctrl-C", "Panda  joint 7, holds"]
    view.advance(30.0)  # pushed by 140 % of what holds
    page._draw()
    assert np.abs(nodes(page)["/8"].wxyz - before).max() > 1e-3


def test_it_ends_with_its_threads(view):
    before = {t.name for t in threading.enumerate()}
    page = PushPage(view, 0)
    url = page.url
    page.close()
    with pytest.raises(OSError):
        urllib.request.urlopen(url, timeout=2)
    left = [t for t in threading.enumerate() if t.name not in before and not t.daemon]
    assert all(t.name.startswith("ThreadPoolExecutor") for t in left)


def test_a_port_that_is_taken_is_one_line(view):
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(StictionError, match=rf"view: port {port}: .*in use.*such as 8081"):
            PushPage(view, port)
    with pytest.raises(StictionError, match="port 70000: no such port"):
        PushPage(view, 70000)


def test_without_viser_one_line_says_what_to_install(view, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(StictionError, match=r"stiction-envs\[web\]"):
        PushPage(view, 0)


@pytest.mark.slow
def test_a_click_in_a_browser_switches_dither_on(page, view, chromium):
    """Nothing but this page is asked for, and an arm is drawn."""
    tab = chromium.new_page(viewport={"width": 1280, "height": 844})
    asked, errors = [], []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("pageerror", lambda error: errors.append(error))
    threading.Thread(target=page.run, args=(lambda line: None,), daemon=True).start()
    tab.goto(page.url)
    tab.get_by_text("Dither on or off").click()
    for _ in range(200):
        if view.push.dithered:
            break
        tab.wait_for_timeout(100)
    shown = Image.open(io.BytesIO(tab.screenshot())).convert("RGB").crop((320, 0, 860, 844))
    page._open = False
    tab.close()
    assert view.push.dithered
    red, green, blue = np.moveaxis(np.array(shown, int), 2, 0)
    lever = (red > 230) & (green < 200) & (blue < 150)
    assert lever.sum() > 200
    assert not errors
    assert all(url.startswith((page.url, "data:", "blob:")) for url in asked)
