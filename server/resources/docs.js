/** Draws the OpenAPI document; nothing is loaded from elsewhere. */
const document_ = await (await fetch('/api/v1/openapi.json')).json();
const $ = (id) => document.getElementById(id);
const el = (tag, text, className) => {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (className) made.className = className;
  return made;
};

/** Schema a reference points to. */
const follow = (schema) => (schema?.$ref ? document_.components.schemas[schema.$ref.split('/').at(-1)] : schema);

/** One line for a schema. */
function inWords(schema) {
  if (!schema) return '';
  if (schema.$ref) return schema.$ref.split('/').at(-1);
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (schema.enum) return schema.enum.map((v) => JSON.stringify(v)).join(' | ');
  const options = schema.anyOf ?? schema.oneOf;
  if (options) return options.map(inWords).join(' | ');
  if (schema.format === 'binary') return 'file';
  if (schema.type === 'array') return `${inWords(schema.items) || 'any'}[]`;
  const bounds = [
    ['minimum', '≥'], ['exclusiveMinimum', '>'], ['maximum', '≤'], ['exclusiveMaximum', '<'], ['maxLength', 'length ≤'],
  ].filter(([key]) => schema[key] !== undefined).map(([key, sign]) => `${sign} ${schema[key]}`);
  return [schema.type ?? 'any', schema.unit && `[${schema.unit}]`, ...bounds].filter(Boolean).join(' ');
}

/** Table of an object's fields, or one line for anything else. */
function fields(schema) {
  const object = follow(schema);
  if (!object?.properties) return el('p', inWords(schema), 'dim');
  const table = el('table');
  for (const [name, property] of Object.entries(object.properties)) {
    const row = table.insertRow();
    row.append(el('td'), el('td', inWords(property)), el('td', property.description, 'dim'));
    row.cells[0].append(el('code', name + (object.required?.includes(name) ? ' *' : '')));
  }
  return table;
}

function example(schema) {
  const object = follow(schema);
  return schema?.examples?.[0] ?? schema?.example ?? object?.examples?.[0] ?? object?.example;
}

function curl(method, path, body) {
  const parts = ['curl', method === 'get' ? '' : `-X ${method.toUpperCase()}`, `'${location.origin}${path}'`].filter(Boolean);
  if (body !== undefined) parts.push(`-H 'content-type: application/json' -d '${JSON.stringify(body)}'`);
  return parts.join(' ');
}

/** A form with its files and its example values. */
function curlForm(path, form) {
  const given = Object.entries(form.properties).filter(([name, property]) => form.required?.includes(name) || property.example !== undefined);
  const parts = given.map(([name, property]) => (property.format === 'binary' ? `-F ${name}=@FILE` : `-F '${name}=${property.example}'`));
  return ['curl', ...parts, `'${location.origin}${path}'`].join(' ');
}

function operation(method, path, about) {
  const box = el('details');
  box.id = about.operationId;
  const summary = el('summary');
  summary.append(el('span', method.toUpperCase(), 'method'), el('code', path), el('span', about.summary, 'dim'));
  const inside = el('div', '', 'inside');
  inside.append(el('p', about.description?.replaceAll('`', '')));
  if (about.parameters?.length) {
    inside.append(el('h3', 'Parameters'));
    const table = el('table');
    for (const parameter of about.parameters) {
      const row = table.insertRow();
      row.append(el('td'), el('td', parameter.in, 'dim'), el('td', inWords(parameter.schema)), el('td', parameter.description, 'dim'));
      row.cells[0].append(el('code', parameter.name + (parameter.required ? ' *' : '')));
    }
    inside.append(table);
  }
  const body = about.requestBody?.content?.['application/json']?.schema;
  const form = about.requestBody?.content?.['multipart/form-data']?.schema;
  if (body) inside.append(el('h3', 'Body'), fields(body));
  if (form) inside.append(el('h3', 'Form'), fields(form));
  inside.append(el('h3', 'Try'), el('pre', form ? curlForm(path, form) : curl(method, path, body ? example(body) ?? {} : undefined)));
  inside.append(el('h3', 'Answers'));
  for (const [status, answer] of Object.entries(about.responses)) {
    const kinds = Object.entries(answer.content ?? {}).map(([kind, content]) => `${kind}${content.schema ? `: ${inWords(content.schema)}` : ''}`);
    const line = el('p');
    line.append(el('b', status), ` ${answer.description ?? ''} `, el('span', kinds.join(', '), 'dim'));
    inside.append(line);
  }
  box.append(summary, inside);
  box.dataset.words = `${method} ${path} ${about.operationId} ${about.summary} ${about.description}`.toLowerCase();
  return box;
}

$('title').textContent = `${document_.info.title} API ${document_.info.version}`;
for (const paragraph of document_.info.description.split('\n\n')) $('about').append(el('p', paragraph.replaceAll('`', '')));
const groups = new Map((document_.tags ?? []).map((tag) => [tag.name, []]));
for (const [path, methods] of Object.entries(document_.paths)) {
  for (const [method, about] of Object.entries(methods)) {
    const tag = about.tags?.[0] ?? 'other';
    if (!groups.has(tag)) groups.set(tag, []);
    groups.get(tag).push(operation(method, path, about));
  }
}
for (const [tag, operations] of groups) {
  const section = el('section');
  section.append(el('h2', tag), el('p', document_.tags?.find((t) => t.name === tag)?.description, 'dim'), ...operations);
  $('operations').append(section);
}
$('operations').removeAttribute('aria-busy');
$('find').addEventListener('input', () => {
  const wanted = $('find').value.toLowerCase().split(/\s+/).filter(Boolean);
  for (const box of document.querySelectorAll('details')) box.hidden = !wanted.every((word) => box.dataset.words.includes(word));
  for (const section of document.querySelectorAll('section')) section.hidden = !section.querySelector('details:not([hidden])');
});
if (location.hash) document.getElementById(location.hash.slice(1))?.setAttribute('open', '');
