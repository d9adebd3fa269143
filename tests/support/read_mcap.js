// Reads an MCAP file with npm's @mcap/core: every record in file order with all checksums, then
// messages, metadata and attachments by the file's indexes. Prints what it found as JSON.
"use strict";
const fs = require("node:fs");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { decompress } = require("fzstd");

const bytes = fs.readFileSync(process.argv[2]);
const decompressHandlers = { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) };
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (offset, size) => bytes.subarray(Number(offset), Number(offset + size)),
};

async function main() {
  const records = {};
  const stream = new McapStreamReader({ validateCrcs: true, includeChunks: true, decompressHandlers });
  stream.append(bytes);
  for (let record; (record = stream.nextRecord()); ) {
    records[record.type] = (records[record.type] ?? 0) + 1;
  }
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const topics = {};
  let last = -1n;
  let ordered = true;
  for await (const message of reader.readMessages()) {
    const { topic } = reader.channelsById.get(message.channelId);
    topics[topic] = (topics[topic] ?? 0) + 1;
    ordered = ordered && message.logTime >= last;
    last = message.logTime;
  }
  const metadata = {};
  for await (const record of reader.readMetadata()) {
    metadata[record.name] = Object.fromEntries(record.metadata);
  }
  const attachments = {};
  for await (const record of reader.readAttachments()) {
    attachments[record.name] = record.data.byteLength;
  }
  const compressions = [...new Set(reader.chunkIndexes.map((chunk) => chunk.compression))];
  const result = { done: stream.done(), records, topics, ordered, metadata, attachments, compressions };
  process.stdout.write(JSON.stringify(result));
}

main().catch((error) => {
  process.stderr.write(String(error.message));
  process.exit(1);
});
