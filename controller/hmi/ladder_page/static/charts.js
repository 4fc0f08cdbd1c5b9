// Step charts with the active steps.

import { make } from "./dom.js";

export class Charts {
  constructor(names, onChosen) {
    this.root = document.getElementById("charts");
    this.names = names;
    this.onChosen = onChosen;
    this.steps = [];
    this.active = new Set();
  }

  /** Fetch the charts the first time that they are shown. */
  async open() {
    const names = this.names.splice(0);
    for (const name of names) {
      const answer = await fetch(`/api/charts/${name}`);
      const picture = new DOMParser().parseFromString(await answer.text(), "image/svg+xml").documentElement;
      picture.querySelectorAll("g.step").forEach((step) => {
        const device = `S${step.dataset.state}`;
        step.addEventListener("click", () => this.onChosen(device));
        this.steps.push([device, step]);
      });
      this.root.append(make("figure", {}, document.adoptNode(picture)));
    }
    this.show(this.active);
  }

  show(active) {
    this.active = active;
    this.steps.forEach(([device, step]) => step.setAttribute("class", active.has(device) ? "step on" : "step"));
  }
}
