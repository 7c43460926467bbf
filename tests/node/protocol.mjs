// The protocol as the .proto files have it.
import path from 'node:path';
import { fileURLToPath } from 'node:url';

import grpc from '@grpc/grpc-js';
import protoLoader from '@grpc/proto-loader';

export const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), '../..');

const services = ['ingest', 'map', 'terrain', 'tile'].map((name) => `gem/v1/${name}_service.proto`);
const definition = protoLoader.loadSync([...services, 'google/rpc/error_details.proto'], {
  includeDirs: [path.join(ROOT, 'proto')],
  keepCase: true,
  longs: String,
  enums: String,
  defaults: true,
  oneofs: true, // a field by the name of each oneof says which one is set
});
const loaded = grpc.loadPackageDefinition(definition);

/// The type of a message by its full name: serialize(object), deserialize(bytes).
export function messageType(name) {
  return definition[name];
}

/// Fills in what an object leaves out, as if it had come over the wire.
export function message(name, object) {
  const type = messageType(name);
  return type.deserialize(type.serialize(object));
}

/// A stub whose unary calls return promises; streams are those of grpc-js.
export function connect(service, address) {
  const stub = new loaded.gem.v1[service](address, grpc.credentials.createInsecure());
  return new Proxy(stub, {
    get(target, name) {
      const method = target[name];
      if (typeof method !== 'function') return method;
      if (!method.path || method.requestStream || method.responseStream) return method.bind(target);
      return (request) =>
        new Promise((resolve, reject) => {
          const deadline = new Date(Date.now() + 60_000);
          method.call(target, request, { deadline }, (error, response) =>
            error ? reject(error) : resolve(response),
          );
        });
    },
  });
}

/// google.rpc details of a failed call, by the last part of their type's name.
export function errorDetails(error) {
  const [bytes] = error.metadata.get('grpc-status-details-bin');
  const details = {};
  if (bytes === undefined) return details;
  for (const any of messageType('google.rpc.Status').deserialize(bytes).details) {
    const name = any.type_url.split('/').pop();
    details[name.split('.').pop()] = messageType(name).deserialize(any.value);
  }
  return details;
}

/// What comes from a stream, one after the other, for as long as is wanted.
export class Answers {
  #stream;
  #iterator;

  constructor(stream) {
    this.#stream = stream;
    this.#iterator = stream[Symbol.asyncIterator]();
  }

  /// undefined at the end; throws what the stream ended with.
  async next() {
    const { value, done } = await this.#iterator.next();
    return done ? undefined : value;
  }

  async all() {
    const messages = [];
    for (let next; (next = await this.next()) !== undefined;) messages.push(next);
    return messages;
  }

  cancel() {
    this.#stream.on('error', () => {}); // that it was cancelled
    this.#stream.cancel();
  }
}

export const { status } = grpc;
