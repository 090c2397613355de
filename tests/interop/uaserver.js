// A node-opcua server in front of whatever answers on standard input and output, one JSON object a line.
//
// First line in: { port, folder, certificate, key, trusted, users, uri, fillers, variables, methods }.
// First line out: { ready: true }. Then questions out { id, op, ... } and answers in { id, status, value }.
"use strict";
console.log = console.warn = console.info = console.error; // standard output carries answers only
const fs = require("fs");
const readline = require("readline");
const opcua = require("node-opcua");

const lines = readline.createInterface({ input: process.stdin });
const waiting = new Map();
let count = 0;
let server = null;
let first = true;
let reader = "";

function ask(question) {
  return new Promise((resolve) => {
    const id = ++count;
    waiting.set(id, resolve);
    process.stdout.write(JSON.stringify({ id, ...question }) + "\n");
  });
}

lines.on("line", (line) => {
  const message = JSON.parse(line);
  if (first) {
    first = false;
    reader = Object.keys(message.users)[0];
    start(message).catch((error) => { console.error(error); process.exit(2); });
    return;
  }
  const resolve = waiting.get(message.id);
  waiting.delete(message.id);
  if (resolve) resolve(message);
});
lines.on("close", () => process.exit(0));

function status(name) {
  return opcua.StatusCodes[name || "Good"] || opcua.StatusCodes.BadUnexpectedError;
}

function variant(kind, value, isArray) {
  const dataType = opcua.DataType[kind];
  if (kind === "ByteString" && value !== null) value = Buffer.from(value, "base64");
  if (isArray) {
    const given = kind === "Double" ? Float64Array.from(value) : value;
    return new opcua.Variant({ dataType, arrayType: opcua.VariantArrayType.Array, value: given });
  }
  return new opcua.Variant({ dataType, value });
}

function plain(given) {
  if (Buffer.isBuffer(given.value)) return given.value.toString("base64");
  return ArrayBuffer.isView(given.value) ? Array.from(given.value) : given.value;
}

function user(context) {
  const token = context && context.session ? context.session.userIdentityToken : null;
  return token && token.userName ? token.userName : "";
}

function addVariable(space, parent, path, spec) {
  const node = space.addVariable({
    componentOf: parent,
    nodeId: "s=" + path,
    browseName: path.split("/").pop(),
    dataType: spec.kind,
    valueRank: spec.array ? 1 : -1,
    arrayDimensions: spec.array ? [0] : null,
    minimumSamplingInterval: 100,
  });
  // The server refreshes a variable before each read; who asks is not told there, so the first user does.
  node.bindVariable({
    refreshFunc: (callback) => {
      ask({ op: "read", path, user: reader }).then((got) => {
        const now = new Date();
        callback(null, got.status
          ? new opcua.DataValue({ statusCode: status(got.status), serverTimestamp: now })
          : new opcua.DataValue({
            value: variant(spec.kind, got.value, spec.array),
            statusCode: opcua.StatusCodes.Good, sourceTimestamp: now, serverTimestamp: now,
          }));
      });
    },
  });
  const ownCheck = node.writeValue.bind(node);
  node.writeValue = (context, dataValue, range, callback) => {
    const done = typeof range === "function" ? range : callback;
    const given = dataValue.value;
    const wrongType = !given || given.dataType !== opcua.DataType[spec.kind];
    if (wrongType) return ownCheck(context, dataValue, range, callback);
    if (dataValue.sourceTimestamp || dataValue.serverTimestamp) {
      return done(null, opcua.StatusCodes.BadWriteNotSupported);
    }
    ask({ op: "write", path, value: plain(given), user: user(context) })
      .then((got) => done(null, status(got.status)));
  };
}

function addMethod(space, parent, name, spec) {
  const named = (list) => list.map(([argument, kind]) => ({
    name: argument, dataType: opcua.DataType[kind], description: { text: argument },
  }));
  const method = space.addMethod(parent, {
    nodeId: "s=" + spec.path, browseName: name,
    inputArguments: named(spec.inputs), outputArguments: named(spec.outputs),
  });
  method.bindMethod((inputs, context, callback) => {
    const values = inputs.map(plain);
    const types = inputs.map((input) => opcua.DataType[input.dataType]);
    ask({ op: "call", name, values, types, user: user(context) }).then((got) => callback(null, {
      statusCode: status(got.status),
      outputArguments: got.status ? [] : spec.outputs.map(([, kind], n) => variant(kind, got.value[n], false)),
    }));
  });
}

async function start(config) {
  const trust = new opcua.OPCUACertificateManager({
    rootFolder: config.folder, automaticallyAcceptUnknownCertificate: false,
  });
  await trust.initialize();
  for (const file of config.trusted) await trust.trustCertificate(fs.readFileSync(file));
  server = new opcua.OPCUAServer({
    port: config.port, host: "127.0.0.1", hostname: "127.0.0.1", resourcePath: "/",
    serverCertificateManager: trust, userCertificateManager: trust,
    certificateFile: config.certificate, privateKeyFile: config.key,
    serverInfo: { applicationUri: config.uri, productUri: config.uri, applicationName: { text: "interop" } },
    securityPolicies: config.strict
      ? [opcua.SecurityPolicy.Basic256Sha256] : [opcua.SecurityPolicy.None, opcua.SecurityPolicy.Basic256Sha256],
    securityModes: config.strict
      ? [opcua.MessageSecurityMode.SignAndEncrypt]
      : [opcua.MessageSecurityMode.None, opcua.MessageSecurityMode.SignAndEncrypt],
    allowAnonymous: false, disableDiscovery: true,
    userManager: { isValidUser: (name, password) => config.users[name] === password },
    serverCapabilities: { operationLimits: { maxNodesPerRead: config.most || 1000, maxNodesPerWrite: config.most || 1000 } },
  });
  await server.initialize();
  const space = server.engine.addressSpace;
  for (let n = 0; n < config.fillers; n++) space.registerNamespace("urn:filler:" + n);
  const own = space.registerNamespace("SinumerikVarProvider");
  const root = own.addObject({ organizedBy: space.rootFolder.objects, nodeId: "s=Sinumerik", browseName: "Sinumerik" });
  for (const [path, spec] of Object.entries(config.variables)) addVariable(own, root, path, spec);
  const folders = { "": root };
  for (const [name, spec] of Object.entries(config.methods)) {
    const folder = spec.path.slice(0, spec.path.lastIndexOf("/"));
    let under = root;
    let path = "";
    for (const part of folder.split("/").slice(1)) {
      path += "/" + part;
      folders[path] = folders[path] || own.addObject({ componentOf: under, nodeId: "s=" + path, browseName: part });
      under = folders[path];
    }
    addMethod(own, under, name, spec);
  }
  await server.start();
  process.stdout.write(JSON.stringify({ ready: true }) + "\n");
}
