-- Shows recordings of fxagent in Wireshark: `fxagent replay FILE --pcapng OUT.pcapng`.
--   wireshark -X lua_script:fxagent.lua OUT.pcapng
-- Or copy this file to the plugin folder (Help, About, Folders, Personal Lua Plugins).
-- fxagent has explained each frame. This script only shows the explanation: it knows no protocol. A packet is: version,
-- way, the texts link, device, protocol, milliseconds and meaning, the number of fields, name and meaning of each field,
-- and the bytes of the frame. A text begins with its length, two bytes.

local recorded = Proto("fxagent", "fxagent recording")
local ways = {[0] = "out", [1] = "in", [2] = "failed", [3] = "unasked"}
local fields = {
  way = ProtoField.uint8("fxagent.way", "Way", base.DEC, ways),
  link = ProtoField.string("fxagent.link", "Link"),
  device = ProtoField.string("fxagent.device", "Device"),
  protocol = ProtoField.string("fxagent.protocol", "Protocol"),
  after_ms = ProtoField.string("fxagent.after_ms", "Milliseconds since the request"),
  says = ProtoField.string("fxagent.says", "Meaning"),
  field = ProtoField.string("fxagent.field", "Field"),
  bytes = ProtoField.bytes("fxagent.bytes", "Frame"),
}
recorded.fields = {fields.way, fields.link, fields.device, fields.protocol, fields.after_ms, fields.says, fields.field,
                   fields.bytes}

function recorded.dissector(buffer, packet, tree)
  local at = 2
  local function text()
    local length = buffer(at, 2):uint()
    local range = length > 0 and buffer(at + 2, length) or nil
    at = at + 2 + length
    return range, range and range:string(ENC_UTF_8) or ""
  end
  if buffer:len() < 2 or buffer(0, 1):uint() ~= 1 then return 0 end
  local part = tree:add(recorded, buffer())
  local way = buffer(1, 1):uint()
  part:add(fields.way, buffer(1, 1))
  local texts = {}
  for _, name in ipairs({"link", "device", "protocol", "after_ms", "says"}) do
    local range, value = text()
    texts[name] = value
    if range then part:add(fields[name], range, value) end
  end
  local count = buffer(at, 1):uint()
  at = at + 1
  for _ = 1, count do
    local begin = at
    local _, name = text()
    local _, meaning = text()
    part:add(fields.field, buffer(begin, at - begin), name .. ": " .. meaning)
  end
  if at < buffer:len() then part:add(fields.bytes, buffer(at)) end
  packet.cols.protocol = texts.protocol ~= "" and texts.protocol or "fxagent"
  packet.cols.src = way == 0 and "agent" or texts.device
  packet.cols.dst = way == 0 and texts.device or "agent"
  packet.cols.info = ways[way] .. " " .. texts.says
  return buffer:len()
end

DissectorTable.get("wtap_encap"):add(wtap.USER0, recorded)
