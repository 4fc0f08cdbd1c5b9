// Elements made and changed; nothing here knows of the machine.

const SVG = "http://www.w3.org/2000/svg";

/** Make an HTML element: attributes by name, `text`, `on: {event: handler}`; then its children. */
export function make(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/** Make an SVG element; arguments as for `make`. */
export function draw(tag, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") node.textContent = value;
    else if (name === "on") Object.entries(value).forEach(([event, handler]) => node.addEventListener(event, handler));
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

/** Write a text only where it is another: ten times a second most are the same. */
export function write(node, text) {
  const now = String(text);
  if (node.textContent !== now) node.textContent = now;
}

/** Set an attribute only where it is another; null takes it away. */
export function mark(node, name, value) {
  if (value === null || value === undefined || value === false) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
  } else if (node.getAttribute(name) !== String(value)) {
    node.setAttribute(name, String(value));
  }
}

/** Move an SVG element to a place in the drawing's units; the style sheet decides how smoothly. */
export function move(node, x, y, turned = "") {
  const transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)${turned}`;
  if (node.style.transform !== transform) node.style.transform = transform;
}

/** Put other children in place of those that are there. */
export function refill(node, ...children) {
  node.replaceChildren(...children.filter((child) => child !== null && child !== undefined));
}
