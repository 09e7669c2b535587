-- Ardour without its window loads a plugin into a track and saves the session; see tools/plugin-hosts.
-- arg: the session's folder, the kind of plugin (LV2 or VST3), a part of its name
local folder, kind, name = arg[1], arg[2], arg[3]
AudioEngine:set_backend("None (Dummy)", "", "")
local session = create_session(folder, "hosts", 48000)
assert(session, "there is no session")
local id
for plugin in ARDOUR.LuaAPI.list_plugins():iter() do
	if plugin.name == name and plugin.type == ARDOUR.PluginType[kind] then
		id = plugin.unique_id
		assert(plugin:is_instrument(), "it is no instrument")
	end
end
assert(id, "it is not found")
local midi, stereo = ARDOUR.ChanCount(ARDOUR.DataType("midi"), 1), ARDOUR.ChanCount(ARDOUR.DataType("audio"), 2)
local tracks = session:new_midi_track(
	midi, stereo, true, ARDOUR.PluginInfo(), nil, nil, 1, "plays", ARDOUR.PresentationInfo.max_order, ARDOUR.TrackMode.Normal, true
)

sleep(1) -- Ardour may still be making its ports
for track in tracks:iter() do
	local made = ARDOUR.LuaAPI.new_plugin(session, id, ARDOUR.PluginType[kind], "")
	assert(not made:isnil(), "it cannot be made")
	assert(track:add_processor_by_index(made, 0, nil, true) == 0, "it cannot be put into the track")
	assert(made:to_plugininsert():signal_latency() > 0, "it has no latency")
end
sleep(1)
session:save_state("")
print("SAVED " .. name)
close_session()
