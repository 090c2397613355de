// A node-opcua client that works through one conversation with a control and prints what it saw as JSON.
//
// Argument: { url, user, password, certificate, key, uri, folder, name }.
"use strict";
console.log = console.warn = console.info = console.error; // standard output carries the result only
const opcua = require("node-opcua");

const config = JSON.parse(process.argv[2]);
const seen = {};

async function connected(use) {
  const trust = new opcua.OPCUACertificateManager({
    rootFolder: config.folder, automaticallyAcceptUnknownCertificate: true,
  });
  await trust.initialize();
  const client = opcua.OPCUAClient.create({
    applicationUri: config.uri, applicationName: "interop",
    securityMode: opcua.MessageSecurityMode.SignAndEncrypt,
    securityPolicy: opcua.SecurityPolicy.Basic256Sha256,
    certificateFile: config.certificate, privateKeyFile: config.key, clientCertificateManager: trust,
    endpointMustExist: false, connectionStrategy: { maxRetry: 0, initialDelay: 100 },
    requestedSessionTimeout: 20000,
  });
  try {
    await client.connect(config.url);
    await use(client);
  } finally {
    await client.disconnect();
  }
}

const token = (password) => ({ type: opcua.UserTokenType.UserName, userName: config.user, password });

async function failure(work) {
  try {
    await work();
    return "";
  } catch (error) {
    return String(error.message || error);
  }
}

async function talk(session) {
  const names = await session.readNamespaceArray();
  const index = names.indexOf("SinumerikVarProvider");
  seen.index = index;
  const id = (path) => `ns=${index};s=${path}`;
  const value = async (path) => {
    const got = await session.read({ nodeId: id(path), attributeId: opcua.AttributeIds.Value });
    return [got.statusCode.name, got.value && got.value.value];
  };
  const write = async (path, dataType, given) => (await session.write({
    nodeId: id(path), attributeId: opcua.AttributeIds.Value, value: { value: { dataType, value: given } },
  })).name;
  const call = async (object, method, kinds, values) => {
    const got = await session.call({
      objectId: id(object), methodId: id(method),
      inputArguments: values.map((one, n) => ({
        dataType: opcua.DataType[kinds[n]], arrayType: opcua.VariantArrayType.Scalar, value: one,
      })),
    });
    return [got.statusCode.name, ...(got.outputArguments || []).map((one) => one.value)];
  };

  seen.status = await value("/Channel/State/chanStatus");
  seen.axis = await value("/NC/_N_NC_TEA_ACX/$MN_AXCONF_MACHAX_NAME_TAB[u1,3]");
  seen.absent = await value("/Channel/MachineAxis/aaStat[u1,9]");
  seen.written = await write("/Channel/Parameter/R[u1,90]", opcua.DataType.Double, 12.5);
  seen.wrongType = await write("/Channel/Parameter/R[u1,90]", opcua.DataType.Int32, 12);
  seen.notWritable = await write("/Channel/State/chanStatus", opcua.DataType.UInt16, 1);
  const block = await value("/Channel/Parameter/R[u1,88,#4]");
  seen.block = [block[0], Array.from(block[1])];

  const browsed = await session.browse(id("Sinumerik"));
  seen.browsed = browsed.references.map((one) => one.browseName.name);

  const methods = "/Methods/Filehandling";
  const file = `Sinumerik/FileSystem/Part Program/${config.name}`;
  const text = Buffer.from("; a line\nM30\n".repeat(2000));
  const copy = (overwrite) => call(methods, `${methods}/CopyFileToServer`, ["String", "ByteString", "Boolean"], [file, text, overwrite]);
  seen.copied = await copy(true);
  seen.copiedAgain = await copy(false);
  const back = await call(methods, `${methods}/CopyFileFromServer`, ["String"], [file]);
  seen.same = back[0] === "Good" && Buffer.compare(back[1], text) === 0;
  seen.selected = await call(methods, `${methods}/Select`, ["String", "Int32"], [file, 1]);
  seen.otherChannel = await call(methods, `${methods}/Select`, ["String", "Int32"], [file, 2]);

  const node = file.replace(config.name, config.name.toUpperCase());
  const opened = await call(node, `${node}.Open`, ["Byte"], [1]);
  await call(node, `${node}.SetPosition`, ["UInt32", "UInt64"], [opened[1], [0, 2]]);
  const part = await call(node, `${node}.Read`, ["UInt32", "Int32"], [opened[1], 6]);
  seen.part = part[1].toString();
  seen.closed = await call(node, `${node}.Close`, ["UInt32"], [opened[1]]);
  seen.rights = (await call("/Methods", "/Methods/GetMyAccessRights", [], []))[1];

  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 100, requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 10,
    maxNotificationsPerPublish: 0, publishingEnabled: true, priority: 1,
  });
  const events = [];
  const item = await subscription.monitor(
    { nodeId: id("Sinumerik"), attributeId: opcua.AttributeIds.EventNotifier },
    { queueSize: 100, filter: opcua.constructEventFilter(["EventType", "Message", "Severity", "AlarmIdentifier"]) },
    opcua.TimestampsToReturn.Neither, opcua.MonitoringMode.Reporting,
  );
  const refreshed = new Promise((resolve) => item.on("changed", (fields) => {
    events.push(fields.slice(1).map((one) => (one.value && one.value.text !== undefined ? one.value.text : one.value)));
    if (fields[0].value.toString() === "ns=0;i=2788") resolve();
  }));
  const refresh = await session.call({
    objectId: "i=2782", methodId: "i=3875",
    inputArguments: [{ dataType: opcua.DataType.UInt32, value: subscription.subscriptionId }],
  });
  await refreshed;
  seen.refresh = refresh.statusCode.name;
  seen.events = events;
  await subscription.terminate();
}

async function main() {
  seen.wrongPassword = await failure(() => connected((client) => client.createSession(token("wrong"))));
  if (config.denied) {
    seen.denied = await failure(() => connected((client) => client.createSession(token(config.password))));
  } else {
    await connected(async (client) => {
      const session = await client.createSession(token(config.password));
      try {
        await talk(session);
      } finally {
        await session.close();
      }
    });
  }
  process.stdout.write(JSON.stringify(seen) + "\n");
}

main().then(() => process.exit(0), (error) => { console.error(error); process.exit(1); });
