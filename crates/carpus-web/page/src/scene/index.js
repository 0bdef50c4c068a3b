// The part of a page that draws in three dimensions: an artefact of its own, that reports and pages of models embed.
export { decoded } from "./posture.js";
export { View3d } from "./view3d.js";
