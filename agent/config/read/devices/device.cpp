#include "agent/config/read/sections.h"

#include <algorithm>
#include <array>
#include <boost/container_hash/hash.hpp>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <unordered_set>
#include <utility>

#include "agent/config/keys.h"
#include "agent/config/read/devices/templates.h"
#include "agent/config/suggestions.h"
#include "agent/text/text.h"
#include "protocol/plc.h"
#include "protocol/value/span.h"

namespace fxagent {
namespace {

std::vector<std::string_view> option_keys(const ProtocolInfo& protocol) {
  std::vector<std::string_view> keys;
  keys.reserve(protocol.options.size());
  for (const OptionSpec& spec : protocol.options) keys.push_back(spec.key);
  return keys;
}

/// True if one read by a way can hold the span. `max_block_bytes` 0: no limit.
bool fits_one_read(const Span& span, const std::vector<ReadWay>& ways,
                   std::uint32_t max_block_bytes) {
  return std::ranges::any_of(ways, [&](const ReadWay& way) {
    std::uint32_t bits = way.max_bits;
    if (max_block_bytes != 0) bits = std::min(bits, max_block_bytes * 8);
    bits = std::max(bits / way.unit_bits * way.unit_bits, way.unit_bits);
    return span.first_bit % way.align_bits + span.bits <= bits;
  });
}

/// Makes each codec, TagUnits and list of tags once, for all devices with an equal one: a large
/// plant has few different ones.
class SharedParts final {
 public:
  struct Protocol {
    std::shared_ptr<const Codec> codec;
    std::shared_ptr<const Options> options;
  };

  /// Returns the codec of these options. Error: as ProtocolInfo::make.
  Result<Protocol> protocol_of(const ProtocolInfo& info, Options options) {
    const std::pair kind(&info, std::move(options));
    if (const auto known = protocols_.find(kind); known != protocols_.end()) return known->second;
    auto codec = info.make(kind.second);
    if (!codec) return tl::unexpected(codec.error());
    return protocols_.emplace(kind, Protocol{*codec, std::make_shared<const Options>(kind.second)})
        .first->second;
  }

  /// Returns the codec for each of ProtocolInfo::models. `open` is one whose model is unknown.
  const std::vector<std::shared_ptr<const Codec>>& models_of(const ProtocolInfo& info,
                                                             const Codec& open) {
    auto& models = models_[&open];
    if (models.empty())
      for (const std::string_view model : info.models)
        models.push_back(open.plc()->with_model(model));
    return models;
  }

  std::shared_ptr<const TagUnits> units_of(TagUnits units) {
    if (units == TagUnits{}) return no_units();
    return *units_.insert(std::make_shared<const TagUnits>(std::move(units))).first;
  }

  SharedVector<TagConfig> tags_of(SharedVector<TagConfig> tags) {
    return *tags_.insert(std::move(tags)).first;
  }

 private:
  struct ByValue {
    bool operator()(const auto& one, const auto& other) const { return *one < *other; }
  };

  /// Hashes the members that commonly differ between lists.
  struct HashOfTags {
    std::size_t operator()(const SharedVector<TagConfig>& tags) const {
      std::size_t hash = tags.size();
      for (const TagConfig& tag : tags) {
        boost::hash_combine(hash, std::string_view(tag.name));
        boost::hash_combine(hash, std::string_view(tag.point.address.text));
        boost::hash_combine(hash, tag.point.scale);
        boost::hash_combine(hash, tag.point.offset);
        boost::hash_combine(hash, tag.units.get());  // of units_of()
      }
      return hash;
    }
  };

  std::map<std::pair<const ProtocolInfo*, Options>, Protocol> protocols_;
  std::map<const Codec*, std::vector<std::shared_ptr<const Codec>>> models_;
  std::set<std::shared_ptr<const TagUnits>, ByValue> units_;
  std::unordered_set<SharedVector<TagConfig>, HashOfTags> tags_;
};

/// Reads one device. If its protocol is missing or wrong, reads on without a codec, so that other
/// errors in its tags are still reported.
class DeviceReader {
 public:
  DeviceReader(ConfigReader& reader, DeviceEntry& entry, SharedParts& shared, DeviceConfig& device)
      : reader_(reader), entry_(entry), node_(entry.members()), shared_(shared), device_(device) {}

  /// False if the entry is not an object.
  bool read_protocol();
  void read_rest();

 private:
  void check_foreign_key(const ConfigNode& member);
  const ConfigNode& culprit(const Options& options, const Error& error) const;
  std::optional<std::string_view> read_model();
  void make_codec();
  template <class Judge>
  auto by_any_model(Judge judge);
  /// Makes the timeout longer than the time after which the device itself gives up and replies with
  /// an error. Warns if a configured timeout is not longer, or too short for any answer.
  void outlast_device();
  /// Warns if the PLC must be asked for its model and some model lacks an address of the config.
  void warn_of_open_model();
  void read_groups();
  void read_tags();
  void read_tag(const ConfigNode& node);
  std::uint32_t group_of(const ConfigNode& tag);
  bool read_place(const ConfigNode& node, TagConfig& tag);
  void read_shape(const ConfigNode& node, std::optional<DataType> type, Point& point);
  void check_span(const ConfigNode& node, const TagConfig& tag);
  /// Warns of values that take several reads, and of deadbands in groups that publish every poll:
  /// once each, at the first.
  void warn_of_tags();
  void check_exists(const ConfigNode& address, const Span& span);
  void read_commands(const ConfigNode& node);
  void read_allow(const ConfigNode& list);

  ConfigReader& reader_;
  DeviceEntry& entry_;
  const ConfigNode& node_;  ///< the entry's members
  SharedParts& shared_;
  DeviceConfig& device_;
  /// The device's codec, shared with `device_.codec`; that of the widest model if the PLC must be
  /// asked for its model. nullptr if protocol, model or options are wrong.
  std::shared_ptr<const Codec> codec_;
  /// Codecs of all models, the widest first, if the one in the file is wrong; see by_any_model().
  std::vector<std::shared_ptr<const Codec>> models_;
  NameTable groups_;
  NameTable tags_;
  std::map<std::uint16_t, std::vector<ReadWay>> ways_;  ///< of codec_
  /// Tags with the same cause for a warning.
  struct Alike {
    const ConfigNode* first = nullptr;
    std::size_t count = 0;

    void add(const ConfigNode& at) {
      if (count++ == 0) first = &at;
    }
    /// Returns ", and 3 other tags of this device, too"; empty if there is only one.
    std::string others() const {
      return count < 2 ? "" : ", and " + counted(count - 1, "other tag") + " of this device, too";
    }
  };
  Alike torn_;            ///< addresses of values that take several reads
  Alike idle_deadbands_;  ///< in groups that publish every poll
};

// ---- protocol and options ---------------------------------------------------------------------

bool DeviceReader::read_protocol() {
  const ConfigKey protocol = protocol_key();
  if (node_.find(protocol.name) != nullptr) {
    if (const auto index = reader_.choice(node_, protocol)) device_.protocol = &catalog()[*index];
  } else if (node_.kind == ConfigNode::Kind::object) {
    reader_.error(node_, "\"protocol\" is missing: " + one_of(protocol.limits.words));
  }

  // Without a valid protocol, accept the keys of every protocol.
  std::vector<std::string_view> options;
  std::vector<std::string_view> foreign;
  for (const ProtocolInfo& info : catalog()) {
    const bool own = device_.protocol == nullptr || device_.protocol == &info;
    for (const auto key : option_keys(info)) (own ? options : foreign).push_back(key);
  }
  if (!reader_.check_object(node_, "devices[]", options, foreign)) return false;
  for (const ConfigNode& member : node_.children) check_foreign_key(member);
  return true;
}

/// Reports a key of other protocols. The error names these, and the options of this protocol.
void DeviceReader::check_foreign_key(const ConfigNode& member) {
  if (device_.protocol == nullptr || option_named(*device_.protocol, member.key) != nullptr ||
      contains(config_section("devices[]"), member.key, &ConfigKey::name))
    return;
  std::vector<std::string_view> owners;
  for (const ProtocolInfo& info : catalog())
    if (option_named(info, member.key) != nullptr) owners.push_back(info.name);
  if (owners.empty()) return;  // unknown key, already reported
  reader_.error_at_key(member, "is for " + one_of(owners) + "; " +
                                   std::string(device_.protocol->name) + " may have " +
                                   one_of(option_keys(*device_.protocol)));
}

/// Returns the option that caused the codec's error: with its default the error would not occur.
/// Returns the device if no single option is the cause.
const ConfigNode& DeviceReader::culprit(const Options& options, const Error& error) const {
  const Options defaults = default_options(*device_.protocol);
  for (const OptionSpec& spec : device_.protocol->options) {
    const ConfigNode* given = node_.find(spec.key);
    if (given == nullptr) continue;
    Options others = options;
    others.insert_or_assign(std::string(spec.key), defaults.find(spec.key)->second);
    const auto codec = device_.protocol->make(others);
    if (codec || codec.error().text != error.text) return *given;
  }
  return node_;
}

/// Returns the device's model; "auto" if it has none, nullopt if it is wrong.
std::optional<std::string_view> DeviceReader::read_model() {
  const ProtocolInfo& protocol = *device_.protocol;
  const ConfigNode* given = node_.find("model");
  if (given == nullptr) return kAutoModel;
  if (protocol.models.empty()) {
    if (const auto word = reader_.text(*given); word && *word != kAutoModel)
      reader_.error(*given, std::string(protocol.name) +
                                " has no models: leave \"model\" out, or set it to auto");
    return kAutoModel;
  }
  const ConfigKey key = model_key(protocol);
  const std::string said = reader_.replaced(*given);
  const auto meant = model_meant(said);
  if (!meant.empty() && !contains(key.limits.words, meant)) {
    reader_.error(*given, model_is_not_reached(protocol, meant));
    return std::nullopt;
  }
  if (!meant.empty() && !contains(key.limits.words, said)) {
    reader_.error(*given, "must be " + one_of(key.limits.words) + ", found \"" +
                              shown(given->text) + "\"; did you mean " + std::string(meant) + "?");
    return std::nullopt;
  }
  const auto model = reader_.choice(node_, key);
  return model ? std::optional(key.limits.words[*model]) : std::nullopt;
}

void DeviceReader::make_codec() {
  const ProtocolInfo& protocol = *device_.protocol;
  Options options = default_options(protocol);
  for (const OptionSpec& spec : protocol.options) {
    const ConfigKey key = option_key(spec);
    OptionValue& value = options[std::string(spec.key)];
    switch (spec.kind) {
      case OptionSpec::Kind::integer:
        value = reader_.integer(node_, key).value_or(key.number());
        break;
      case OptionSpec::Kind::boolean:
        value = reader_.boolean(node_, key);
        break;
      case OptionSpec::Kind::choice:
        const std::size_t index = reader_.choice_or_default(node_, key);
        value = std::string(spec.choices[index]);
        if (spec.key == "enquire") device_.enquire = static_cast<EnquirePolicy>(index);
        break;
    }
  }

  const auto model = read_model();
  options.insert_or_assign("model", std::string(model.value_or(kAutoModel)));

  auto made = shared_.protocol_of(protocol, options);
  if (!made) {
    const ConfigNode& cause = culprit(options, made.error());
    reader_.error(cause, made.error().text);
    if (const OptionSpec* spec = option_named(protocol, cause.key))
      options.insert_or_assign(cause.key, spec->fallback);
    made = shared_.protocol_of(protocol, options);
    if (!made) return;
  }
  device_.codec = made->codec;
  device_.options = made->options;
  codec_ = widest_of(protocol, made->codec);
  if (!model) {
    models_ = shared_.models_of(protocol, *made->codec);
    models_.insert(models_.begin(), codec_);
  }

  if (const auto* bytes = option<std::int64_t>(options, "max_block_bytes"))
    device_.max_block_bytes = static_cast<std::uint32_t>(*bytes);
}

/// Returns judge() of the device's addresses. If the model in the file is wrong, returns an error
/// only if every model has one, and then that of the widest model; otherwise continues with the
/// codec of a model that has none.
template <class Judge>
auto DeviceReader::by_any_model(Judge judge) {
  auto result = judge(codec_->addresses());
  for (std::size_t i = 0; !result && i < models_.size(); ++i) {
    auto other = judge(models_[i]->addresses());
    if (other) {
      codec_ = models_[i];
      ways_.clear();
    }
    if (other || i == 0) result = std::move(other);
  }
  return result;
}

void DeviceReader::read_rest() {
  reader_.set_integer(device_.timeout, node_, "devices[].timeout_ms");
  reader_.set_integer(device_.retries, node_, "devices[].retries");
  reader_.set_integer(device_.gap, node_, "devices[].gap_ms");
  reader_.set_integer(device_.turnaround, node_, "devices[].turnaround_ms");
  device_.echo = reader_.boolean(node_, "devices[].echo");
  if (device_.protocol == nullptr || option_named(*device_.protocol, "max_block_bytes") == nullptr)
    device_.max_block_bytes =
        static_cast<std::uint32_t>(reader_.integer(node_, "devices[].max_block_bytes").value_or(0));
  if (device_.protocol != nullptr) make_codec();
  if (device_.codec != nullptr) outlast_device();
  read_groups();
  read_tags();
  if (const ConfigNode* commands = reader_.object(node_, "devices[].commands"))
    read_commands(*commands);
  if (device_.codec != nullptr) warn_of_open_model();
}

void DeviceReader::outlast_device() {
  const auto own = device_.codec->gives_up_after();
  const bool has_timer = option_named(*device_.protocol, "monitoring_timer_ms") != nullptr;
  const ConfigNode* given = node_.find("timeout_ms");
  if (given == nullptr)
    device_.timeout += own;
  else if (node_.find("turnaround_ms") != nullptr && device_.timeout < device_.turnaround)
    reader_.warn(*given, "timeout_ms is shorter than turnaround_ms, the " +
                             std::to_string(device_.turnaround.count()) +
                             " ms that the device may need before it answers: make timeout_ms "
                             "longer, or turnaround_ms shorter");
  else if (device_.timeout <= own)
    reader_.warn(*given,
                 "timeout_ms is not longer than the " + std::to_string(own.count()) +
                     " ms after which the device itself gives up and reports why. The agent would "
                     "miss that report: make timeout_ms longer or " +
                     (has_timer ? "monitoring_timer_ms" : "the device's time") + " shorter");
}

// ---- groups -----------------------------------------------------------------------------------

void DeviceReader::warn_of_open_model() {
  if (!must_ask_model(*device_.codec)) return;
  const ProtocolInfo& protocol = *device_.protocol;
  std::vector<Span> spans = device_.commands.allow;
  for (const TagConfig& tag : device_.tags)
    if (const auto span = span_of(tag.point)) spans.push_back(*span);
  const auto models = shared_.models_of(protocol, *device_.codec);
  for (std::size_t i = 0; i < models.size(); ++i)
    for (const Span& span : spans) {
      const AddressSpace& addresses = models[i]->addresses();
      if (addresses.check_range(span)) continue;
      const ConfigNode* given = node_.find("model");
      return reader_.warn(given != nullptr ? *given : node_,
                          "model auto: checked against " + widest_name(protocol) + "; " +
                              codec_->addresses().name_of({span.space, span.end_bit() - 1, 1}) +
                              " is not in every model (" + std::string(protocol.models[i]) +
                              " lacks it), and bad if the PLC lacks it");
    }
}

void DeviceReader::read_groups() {
  const auto nodes = entry_.items(reader_, "devices[].groups");
  if (!reader_.has_room(entry_.node(), {.groups = nodes.size()})) return;
  for (const ConfigNode* group_node : nodes) {
    const ConfigNode& node = *group_node;
    if (!reader_.check_object(node, "devices[].groups[]")) {
      groups_.add_unnamed();
      continue;
    }
    GroupConfig group;
    group.name = groups_.read(reader_, node, "devices[].groups[].name",
                              static_cast<std::uint32_t>(device_.groups.size()));
    reader_.set_integer(group.interval, node, "devices[].groups[].interval_ms");
    group.on_change = reader_.choice_or_default(node, "devices[].groups[].publish") == 1;
    reader_.set_integer(group.max_silent, node, "devices[].groups[].max_silent_s");
    warn_of_silence(reader_, node, group);
    device_.groups.push_back(std::move(group));
  }
}

std::uint32_t DeviceReader::group_of(const ConfigNode& tag) {
  const ConfigNode* node = tag.find("group");
  const auto given = reader_.name(tag, "devices[].tags[].group");
  if (node != nullptr && !given) return 0;
  const auto default_group = config_key("devices[].tags[].group").word();
  const std::string name = given.value_or(std::string(default_group));
  if (const auto index = groups_.find(name)) return *index;
  if (name != default_group) {
    groups_.report_unknown(reader_, *node, "this device has no group", name, "; it has no groups");
    return 0;
  }
  // Create the default group, which the device does not define, with the first tag that uses it.
  const auto index = static_cast<std::uint32_t>(device_.groups.size());
  groups_.add(reader_, name, tag, index);
  GroupConfig group;
  group.name = name;
  device_.groups.push_back(std::move(group));
  return index;
}

// ---- tags -------------------------------------------------------------------------------------

void DeviceReader::read_tags() {
  const auto nodes = entry_.items(reader_, "devices[].tags");
  if (codec_ != nullptr && codec_->is_broadcast() && !nodes.empty())
    reader_.error(*node_.find("tags"),
                  "no unit answers a broadcast, so it cannot have tags; list what may be written "
                  "to all units in commands/allow");
  if (!reader_.has_room(entry_.node(), {.tags = nodes.size()})) return;
  device_.tags.reserve(nodes.size());
  for (const ConfigNode* tag : nodes) {
    read_tag(*tag);
    if (reader_.is_over()) return;
  }
  warn_of_tags();
  device_.tags = shared_.tags_of(std::move(device_.tags));
}

void DeviceReader::warn_of_tags() {
  if (torn_.count > 0)
    reader_.warn(*torn_.first, "takes several reads" + torn_.others() +
                                   ": parts of a value may be of different moments. Make max_read "
                                   "or max_block_bytes larger");
  if (idle_deadbands_.count > 0)
    reader_.warn(*idle_deadbands_.first,
                 "does not hold back a sample" + idle_deadbands_.others() +
                     ": the group publishes every poll. Set its \"publish\" to \"on_change\"");
}

void DeviceReader::read_tag(const ConfigNode& node) {
  if (!reader_.check_object(node, "devices[].tags[]")) return;
  TagConfig tag;
  tag.name = tags_.read(reader_, node, "devices[].tags[].name",
                        static_cast<std::uint32_t>(device_.tags.size()));
  tag.group = group_of(node);
  tag.writable = reader_.choice_or_default(node, "devices[].tags[].access") == 1;
  if (read_place(node, tag)) check_span(node, tag);
  tag.units = shared_.units_of(read_tag_units(reader_, node, tag.point.type));
  warn_of_limits(reader_, node, tag);
  const bool is_in_a_group = tag.group < device_.groups.size();  // false after an error
  if (tag.units->limits.deadband && is_in_a_group && !device_.groups[tag.group].on_change)
    idle_deadbands_.add(*node.find("deadband"));
  reader_.has_room(node, {.values = values_of(tag.point)});
  device_.tags.push_back(std::move(tag));
}

/// Reads address, type, shape and scaling of a tag. False if these do not give a span.
bool DeviceReader::read_place(const ConfigNode& node, TagConfig& tag) {
  std::optional<DataType> type;
  const ConfigNode* given = node.find("type");
  if (const auto index = reader_.choice(node, "devices[].tags[].type"))
    type = *data_type_from(config_keys::kTypes[*index]);
  const auto text = reader_.text(node, "devices[].tags[].address");
  bool good = text.has_value() && (given == nullptr || type);
  if (text && codec_ != nullptr) {
    const auto address = by_any_model(
        [&](const AddressSpace& addresses) { return addresses.parse_address(*text, type); });
    if (!address) {
      reader_.error(*node.find("address"), address.error().text);
      good = false;
    } else if (good) {
      tag.point.address = *address;
      if (!type) type = default_type(*address);
    }
  }
  read_shape(node, type, tag.point);
  return type && good && codec_ != nullptr;
}

/// Reads the members that depend on the type. Checks only their ranges if the type is wrong or
/// unknown.
void DeviceReader::read_shape(const ConfigNode& node, std::optional<DataType> type, Point& point) {
  if (type) point.type = *type;
  if (const auto count = reader_.integer(node, "devices[].tags[].count")) {
    point.count = static_cast<std::uint16_t>(*count);
    point.is_array = true;
  }
  const ConfigNode* length = node.find("length");
  point.length =
      static_cast<std::uint16_t>(reader_.integer(node, "devices[].tags[].length").value_or(0));
  if (type == DataType::string && length == nullptr)
    reader_.error(node, "\"length\" is missing: a string needs its number of characters");
  if (type && type != DataType::string && length != nullptr)
    reader_.error_at_key(*length, "is for strings; for an array use \"count\"");

  if (codec_ != nullptr) point.order = codec_->addresses().default_order();
  const ConfigKey word_order = word_order_key(device_.protocol);
  if (const auto index = reader_.choice(node, word_order)) {
    point.order = *byte_order_from(word_order.limits.words[*index]);
    if (type == DataType::boolean)
      reader_.error_at_key(*node.find("word_order"), "a bool has no word order");
  }

  // Only numbers can be scaled; read_tag_units() reports this.
  if (type == DataType::boolean || type == DataType::string) return;
  constexpr const ConfigKey& scale_key = config_key("devices[].tags[].scale");
  constexpr const ConfigKey& offset_key = config_key("devices[].tags[].offset");
  const auto scale = reader_.number(node, scale_key);
  const auto offset = reader_.number(node, offset_key);
  if (!scale && !offset) return;
  if (const auto set = set_units(point, scale.value_or(static_cast<double>(scale_key.number())),
                                 offset.value_or(static_cast<double>(offset_key.number())));
      !set)
    reader_.error(*node.find(scale ? "scale" : "offset"), set.error().text);
}

/// Checks the point's span against the model and, if the tag is writable, against the rules for
/// writes.
void DeviceReader::check_span(const ConfigNode& node, const TagConfig& tag) {
  const ConfigNode& address = *node.find("address");
  const bool text_without_length = tag.point.type == DataType::string && tag.point.length == 0;
  if (text_without_length) return;  // reported with the length
  const auto span = span_of(tag.point);
  if (!span) {
    const ConfigNode* type = node.find("type");
    reader_.error(type != nullptr ? *type : address, span.error().text);
    return;
  }
  check_exists(address, *span);
  const bool is_one_value = !tag.point.is_array && tag.point.type != DataType::string;
  if (is_one_value && !fits_one_read(*span, ways_.at(span->space), device_.max_block_bytes))
    torn_.add(address);
  if (!tag.writable) return;
  const ConfigNode& access = *node.find("access");
  if (!tag.point.address.writable)
    reader_.error(access, tag.point.address.text + " can only be read");
  else if (const auto allowed = by_any_model(
               [&](const AddressSpace& addresses) { return addresses.check_write(*span); });
           !allowed)
    reader_.error(access, "cannot be written: " + allowed.error().text);
}

void DeviceReader::check_exists(const ConfigNode& address, const Span& span) {
  const auto exists =
      by_any_model([&](const AddressSpace& addresses) { return addresses.check_range(span); });
  const auto [entry, fresh] = ways_.try_emplace(span.space);
  if (fresh) entry->second = codec_->addresses().read_ways(span.space);
  if (!exists) {
    reader_.error(address, exists.error().text);
    return;
  }
  const bool reached = std::ranges::any_of(entry->second, [&](const ReadWay& way) {
    return way.first_bit <= span.first_bit && span.end_bit() <= way.end_bit;
  });
  if (!reached)
    reader_.error(address, "the protocol cannot reach " + names_of(codec_->addresses(), span));
}

// ---- commands ---------------------------------------------------------------------------------

void DeviceReader::read_commands(const ConfigNode& node) {
  CommandRules& rules = device_.commands;
  if (const ConfigNode* allow = reader_.array(node, "devices[].commands.allow")) read_allow(*allow);
  rules.allow_run_stop = reader_.boolean(node, "devices[].commands.allow_run_stop");
  if (rules.allow_run_stop && codec_ != nullptr && codec_->plc() == nullptr)
    reader_.warn(*node.find("allow_run_stop"), "has no effect: this protocol has no run and stop");
  reader_.set_integer(rules.max_expiry, node, "devices[].commands.max_expiry_s");
  const auto expiry = reader_.integer(node, "devices[].commands.default_expiry_s");
  // Without a given default_expiry_s, a short max_expiry_s lowers the default too.
  rules.default_expiry =
      expiry ? std::chrono::seconds(*expiry) : std::min(rules.default_expiry, rules.max_expiry);
  if (rules.default_expiry > rules.max_expiry)
    reader_.error(*node.find("default_expiry_s"),
                  "must not be longer than max_expiry_s, which is " +
                      std::to_string(rules.max_expiry.count()));
  rules.verify = reader_.boolean(node, "devices[].commands.verify");
  reader_.set_integer(rules.queue, node, "devices[].commands.queue");
}

/// Reads the ranges of `allow` as spans, sorted and with neighbours merged.
void DeviceReader::read_allow(const ConfigNode& list) {
  std::vector<Span> spans;
  for (const ConfigNode& item : list.children) {
    const auto text = reader_.text(item);
    if (!text || codec_ == nullptr) continue;
    const auto span =
        by_any_model([&](const AddressSpace& addresses) { return addresses.parse_range(*text); });
    if (span)
      spans.push_back(*span);
    else
      reader_.error(
          item, span.error().text +
                    (text->find(',') != text->npos ? "; each range is an entry of its own" : ""));
  }
  device_.commands.allow = merged(std::move(spans));
  if (codec_ != nullptr) warn_of_unchecked_limits(reader_, list, device_);
}

}  // namespace

void read_devices(ConfigReader& reader, const ConfigNode& top, const ConfigNode& devices,
                  Links& links, Config& config) {
  NameTable names;
  FirstStations stations;
  SharedParts shared;
  Templates templates(reader, top);
  config.devices.reserve(devices.children.size());
  const auto read = [&](DeviceEntry& entry) {
    const auto index = static_cast<std::uint32_t>(config.devices.size());
    DeviceConfig& device = config.devices.emplace_back();
    DeviceReader device_reader(reader, entry, shared, device);
    if (!device_reader.read_protocol()) return;
    device.name = reader.name(entry.members(), "devices[].name").value_or("");
    const ConfigNode* name = entry.node().find("name");
    if (!device.name.empty())
      names.add(reader, device.name, name != nullptr ? *name : entry.node(), index);
    join_link(reader, entry, links, device);
    device_reader.read_rest();
    warn_of_station(reader, entry, device, stations);
  };
  for (const ConfigNode& node : devices.children) {
    if (reader.is_over()) break;
    const auto entry = templates.entry(node);
    if (entry == nullptr || !reader.has_room(entry->node(), {.devices = entry->count()})) continue;
    for (std::size_t i = 0; i < entry->count() && !reader.is_over(); ++i) {
      const DeviceOrigin origin = entry->origin(i);
      reader.set_origin(entry->is_made() ? &origin : nullptr);
      const ConfigSize before = reader.room().size();
      read(*entry);
      if (i > 0) continue;
      // The other devices of the entry will be as large as the first one.
      const auto rest = times(entry->count() - 1, reader.room().size(), before);
      if (!reader.room().fits(rest)) reader.has_room(entry->node(), rest);
    }
    reader.set_origin(nullptr);
  }
  templates.warn_of_unused();
}

}  // namespace fxagent
