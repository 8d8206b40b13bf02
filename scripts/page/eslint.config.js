// Faults of meaning only: what a line looks like is left to whoever writes it.
const rules = ["no-undef", "no-unused-vars", "no-unreachable", "no-dupe-keys", "no-self-assign", "no-eval", "no-implied-eval", "no-new-func", "no-redeclare", "no-var", "prefer-const", "eqeqeq", "no-restricted-properties"];
const browser = ["window", "document", "location", "history", "fetch", "WebSocket", "console", "performance", "requestAnimationFrame", "setTimeout", "matchMedia", "ResizeObserver", "createImageBitmap", "ImageData", "Blob", "Event", "getComputedStyle", "devicePixelRatio"];
// A name of a file or a target is text and never markup.
const markup = ["innerHTML", "outerHTML", "insertAdjacentHTML"].map((property) => ({ property, message: "set textContent" }));

export default [
  {
    files: ["src/sonocal/studio/page/*.js"],
    languageOptions: { ecmaVersion: 2022, sourceType: "module", globals: Object.fromEntries(browser.map((name) => [name, "readonly"])) },
    rules: { ...Object.fromEntries(rules.map((rule) => [rule, "error"])), "no-restricted-properties": ["error", ...markup] },
  },
];
