"""The picture of the first page: from a graph to a corrected model, drawn from real numbers."""

import matplotlib.pyplot as plt
from sled import measured, sled

import bondgraph as bg

train, held_out = measured("run1", 1), measured("run2", 2)
model = bg.build(sled())
loop = bg.close_loop(sled(), [train], [held_out])
element = loop.added[0].trial.candidate.effect.element

bg.draw(model, "declared.png")
bg.draw(loop.graph, "found.png", highlight=[element])
equations = model.equations._repr_latex_().strip("$").splitlines()[1:-1]

figure, ((declared, derived), (before, found)) = plt.subplots(
    2, 2, figsize=(11.0, 7.0), gridspec_kw={"wspace": 0.12, "hspace": 0.22}
)
titles = (
    "1  declare: what sits where",
    "2  derive: state equations",
    "3  lay over logs, estimate",
    "4  find what is lacking",
)
for axes, title in zip((declared, derived, before, found), titles, strict=True):
    axes.set_title(title, loc="left", fontweight="bold")
for axes, name in ((declared, "declared.png"), (found, "found.png")):
    picture = plt.imread(name)
    drawn = (picture[..., :3] < 1.0).any(axis=2)  # the drawing without its margins, heading and legend
    drawn[: picture.shape[0] // 5] = drawn[-picture.shape[0] // 6 :] = False
    rows, columns = drawn.any(axis=1).nonzero()[0], drawn.any(axis=0).nonzero()[0]
    axes.imshow(picture[rows[0] : rows[-1], columns[0] : columns[-1]])
    axes.axis("off")
derived.axis("off")
for row, line in enumerate(equations):
    derived.text(0.05, 0.75 - 0.25 * row, f"${line.replace('&', '').rstrip(chr(92) + ' ')}$", fontsize=18)
loop.plot(ax=before)
before.set_title("")
before.set_title(f"{titles[2]} (a run not used)", loc="left", fontweight="bold")
figure.savefig("concepts.svg", bbox_inches="tight")
