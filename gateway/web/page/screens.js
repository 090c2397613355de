// @ts-check
// The screens in the order of a day.
import { capture } from "./capture.js";
import { connect } from "./connect.js";
import { correct } from "./correct.js";
import { evaluate } from "./evaluate.js";
import { model } from "./model.js";
import { push } from "./push.js";
import { report } from "./report.js";

export const screens = { connect, capture, evaluate, model, correct, push, report };
