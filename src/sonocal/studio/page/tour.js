// Two minutes about the page.

const STEPS = [
  ["The image", "The ring is where the needle was found; the cross is where the calibration says that it is. Arrow keys go from image to image, Space plays."],
  ["The verdict", "Whether to use the calibration, and the error to expect. The large number is what 95 of 100 errors stay below at the worst corner."],
  ["The worst sighting", "Press N: the page goes to the sighting that fits least. Is the ring on the needle? If not, click the needle, or press X to drop it. Numbers follow at once; Z undoes."],
  ["Where errors are", "The image plane is coloured by predicted error, among the needles. Drag it. Errors grow where no needle was seen."],
  ["What to scan next", "Below: findings with advice, which parts of the image and which tilts are missing."],
  ["Hand over", "Press E: files for sonocal, PLUS, ITK and 3D Slicer, the same as the command line writes."],
];

export function listenToTour() {
  const guide = /** @type {HTMLDialogElement} */ (document.getElementById("guide")), by = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
  let at = 0;
  const show = () => { if (at >= STEPS.length) { guide.close(); return; } by("guide-title").textContent = `${at + 1} of ${STEPS.length}: ${STEPS[at][0]}`; by("guide-text").textContent = STEPS[at][1]; };
  by("tour").onclick = () => { at = 0; show(); guide.show(); by("guide-next").focus(); };
  by("guide-next").onclick = () => { at++; show(); };
  by("guide-end").onclick = () => guide.close();
}
