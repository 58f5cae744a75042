# %% [markdown]
# # Find the missing effect
#
# The whole way in Python, on the data set that ships with the tool: 300 measured tip positions of a six-joint arm, with
# an effect hidden in them that the first model does not have. The cells run in VS Code or Jupyter, and
# `python docs/example.py` runs them all.

# %%
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import lrm_ident as lrm

folder = Path(mkdtemp())
data = lrm.load(lrm.EXAMPLE)
print(f"{len(data)} poses of {data.arm.name}, measured to {data.noise_sd * 1e3:.1f} mm per axis")

# %% [markdown]
# ## Fit what every arm has: errors of the geometry, and springs in the joints

# %%
study = lrm.Study.of(data).fit()
first = study.compare()
print(f"nominal arm {first.nominal.mean * 1e3:.1f} mm, fitted {first.error.mean * 1e3:.2f} mm,")
print(f"on poses that the fit did not see {first.held_out.error.mean * 1e3:.2f} mm")

# %% [markdown]
# ## See where the model fails

# %%
for factor in first.factors[:3]:
    print(f"{factor.name}: explains {factor.share:.0%}, worst at {factor.worst.label}")
lrm.plot(first, folder / "where.png")

# %% [markdown]
# ## Learn which effect is missing

# %%
diagnosis = study.diagnose()
print(diagnosis.verdict, "-", diagnosis.first.why)
lrm.plot(diagnosis, folder / "why.png")

# %% [markdown]
# ## Add it, and watch the error fall

# %%
better = study.add(diagnosis.first.scored.name)
second = better.compare()
print(f"held out: {first.held_out.error.mean * 1e3:.2f} -> {second.held_out.error.mean * 1e3:.2f} mm")
print("and now:", better.diagnose().verdict)

# %% [markdown]
# ## Show it
#
# Results draw themselves where they are the last line of a cell; `view` is the page of `lrm-ident report`.

# %%
page = better.view()
page  # noqa: B018, the last line of a cell is what is shown

# %% [markdown]
# ## Use the model
#
# `save` writes the file that `lrm-ident` and the daemon read.

# %%
better.save(folder / "model.toml")
model = lrm.load_model(folder / "model.toml")
error = np.linalg.norm(lrm.predict(model, data.poses) - data.tcp, axis=1)
print(f"mean distance of predicted and measured tip: {error.mean() * 1e3:.2f} mm; files in {folder}")
