// Creation and update of DOM elements, for all pages; independent of the machine.

const SVG = "http://www.w3.org/2000/svg";

/** Create an HTML element: attributes by name, `text`, `on: {event: handler}`, followed by the children. */
export function make(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/** Create an SVG element; arguments as for `make`. */
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

/** Set the text of a node only if it differs: the page updates ten times a second. */
export function write(node, text) {
  const now = String(text);
  if (node.textContent !== now) node.textContent = now;
}

/** Set an attribute only if it differs; null removes it. */
export function mark(node, name, value) {
  if (value === null || value === undefined || value === false) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
  } else if (node.getAttribute(name) !== String(value)) {
    node.setAttribute(name, String(value));
  }
}

/** Move an SVG element to a position in drawing units; the transition is defined in the style sheet. */
export function move(node, x, y, turned = "") {
  const transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)${turned}`;
  if (node.style.transform !== transform) node.style.transform = transform;
}

/** Replace all children of a node. */
export function refill(node, ...children) {
  node.replaceChildren(...children.filter((child) => child !== null && child !== undefined));
}
