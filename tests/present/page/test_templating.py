"""What is put into a page is escaped, and what cannot be seen is shown."""

from __future__ import annotations

from markupsafe import Markup

from rovid.present.page.templating import template_environment


def test_text_from_elsewhere_is_shown_for_what_it_is() -> None:
    template = template_environment().from_string("{{ a }} {{ b }} {{ 1234.5678|plain }} {{ 'kg m^2'|unit }}")
    assert template.render(a="<b>\u202e", b=Markup("<i>")) == r"&lt;b&gt;\u202e <i> 1235 kg m²"


def test_a_page_of_another_room_finds_its_own_templates_and_the_shared_style() -> None:
    environment = template_environment("rovid.fleet")
    assert environment.get_template("fleet.html.j2").filename
    assert environment.get_template("style.css").filename
