// SPDX-FileCopyrightText: The ruledgraph developers
// SPDX-License-Identifier: BSD-3-Clause
// Unpacks Plotly, which lies in the page compressed, and draws the figures.
(async () => {
  const plots = [...document.querySelectorAll(".plot")];
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);

  const dark = matchMedia("(prefers-color-scheme: dark)");
  const draw = (plot) => {
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim();
    const line = style.getPropertyValue("--line").trim();
    const figure = JSON.parse(document.getElementById(plot.dataset.figure).textContent);
    figure.layout.font = { color: ink, size: 11 };
    for (const name of ["xaxis", "yaxis", "zaxis"]) {
      Object.assign(figure.layout.scene[name], { gridcolor: line, linecolor: line, color: ink });
    }
    return Plotly.react(plot, figure.data, figure.layout, { responsive: true, displayModeBar: false });
  };
  for (const plot of plots) {
    await draw(plot);
    // On paper a picture of it stands in its place.
    const image = new Image();
    image.className = "printed";
    image.src = await Plotly.toImage(plot, { format: "png", width: 840, height: 640 });
    plot.after(image);
  }
  dark.addEventListener("change", () => plots.forEach(draw));
})().catch(() => {
  // An old browser: the flat views further down show the same.
  for (const plot of document.querySelectorAll(".turning")) plot.remove();
});
