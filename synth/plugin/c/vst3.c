/* vst3.c: where VST 3 hosts come in: the module, its factory, and the object that they get from it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "vst3.h"

/* ---- the object ---- */

static const struct {
    TUID iid;
    int32_t face;
} interfaces[] = {
    {FUnknown_iid, COMPONENT},
    {IPluginBase_iid, COMPONENT},
    {IComponent_iid, COMPONENT},
    {IAudioProcessor_iid, PROCESSOR},
    {IProcessContextRequirements_iid, REQUIREMENTS},
    {IEditController_iid, CONTROLLER},
    {IMidiMapping_iid, MAPPING},
    {IUnitInfo_iid, UNITS},
    {INoteExpressionController_iid, EXPRESSIONS},
};

tresult vst3_query(void *face, const TUID iid, void **object) {
    vst3 *me = vst3_of(face);
    if (!iid || !object) return kInvalidArgument;
    for (size_t k = 0; k < sizeof interfaces / sizeof *interfaces; k++)
        if (!memcmp(iid, interfaces[k].iid, sizeof(TUID))) {
            *object = &me->face[interfaces[k].face];
            vst3_add(face);
            return kResultOk;
        }
    *object = NULL;
    return kNoInterface;
}

uint32_t vst3_add(void *face) { return atomic_fetch_add(&vst3_of(face)->references, 1) + 1; }

static void destroy(vst3 *me) {
    if (!me) return;
    plugin_free(me->plugin);
    free((void *)me->shown);
    free(me->nowhere);
    free(me);
}

uint32_t vst3_release(void *face) {
    vst3 *me = vst3_of(face);
    const uint32_t left = atomic_fetch_sub(&me->references, 1) - 1;
    if (left == 0) destroy(me);
    return left;
}

static vst3 *create(char *why) {
    const void *tables[FACES] = {&vst3_component, &vst3_processor, &vst3_requirements, &vst3_controller,
                                 &vst3_mapping,   &vst3_units,     &vst3_expressions};
    vst3 *me = calloc(1, sizeof *me);
    if (!me || !(me->plugin = plugin_new(why))) {
        free(me);
        return NULL;
    }
    for (int32_t k = 0; k < FACES; k++) me->face[k] = (vst3_face){tables[k], me};
    atomic_init(&me->references, 1);
    me->parameters = plugin_parameters(me->plugin);
    me->rate = jawari_rate_of(plugin_bank(me->plugin), 0);
    vst3_list_midi(me);
    plugin_when_changed(me->plugin, vst3_setup_changed, me);
    me->shown = malloc((me->parameters + me->hidden) * sizeof *me->shown);
    if (!me->shown) {
        destroy(me);
        return NULL;
    }
    for (uint32_t k = 0; k < me->parameters + me->hidden; k++) atomic_init(&me->shown[k], 0.0);
    for (uint32_t k = 0; k < me->hidden; k++) me->shown[me->parameters + k] = vst3_at_rest(me->midi[k]);
    vst3_show_all(me);
    return me;
}

/* ---- the factory ---- */

typedef struct factory {
    const IPluginFactory3 *table;
    atomic_uint references;
    jawari_bank *bank;
} factory;

static uint32_t factory_add(void *self) { return atomic_fetch_add(&((factory *)self)->references, 1) + 1; }

static uint32_t factory_release(void *self) {
    factory *me = self;
    const uint32_t left = atomic_fetch_sub(&me->references, 1) - 1;
    if (left == 0) {
        jawari_close(me->bank);
        free(me);
    }
    return left;
}

static tresult factory_query(void *self, const TUID iid, void **object) {
    static const TUID known[] = {FUnknown_iid, IPluginFactory_iid, IPluginFactory2_iid, IPluginFactory3_iid};
    if (!iid || !object) return kInvalidArgument;
    for (size_t k = 0; k < sizeof known / sizeof *known; k++)
        if (!memcmp(iid, known[k], sizeof(TUID))) {
            *object = self;
            factory_add(self);
            return kResultOk;
        }
    *object = NULL;
    return kNoInterface;
}

static tresult factory_info(void *self, PFactoryInfo *info) {
    (void)self;
    if (!info) return kInvalidArgument;
    memset(info, 0, sizeof *info);
    snprintf(info->vendor, sizeof info->vendor, "jawari");
    info->flags = kUnicode;
    return kResultOk;
}

static int32_t classes(void *self) {
    (void)self;
    return 1;
}

static tresult class_info_2(void *self, int32_t index, PClassInfo2 *info) {
    const factory *me = self;
    if (index != 0 || !info) return kInvalidArgument;
    memset(info, 0, sizeof *info);
    vst3_class_id(jawari_bank_uid(me->bank), info->cid);
    info->cardinality = kManyInstances;
    snprintf(info->category, sizeof info->category, "Audio Module Class");
    int16_t name[64]; /* by way of which it is cut between characters, not within one */
    vst3_wide(name, 64, jawari_bank_name(me->bank));
    vst3_narrow(info->name, sizeof info->name, name);
    info->classFlags = kSimpleModeSupported;
    snprintf(info->subCategories, sizeof info->subCategories, "Instrument|Synth");
    snprintf(info->vendor, sizeof info->vendor, "jawari");
    snprintf(info->version, sizeof info->version, "%.63s", jawari_version());
    snprintf(info->sdkVersion, sizeof info->sdkVersion, "VST 3.7.4");
    return kResultOk;
}

static tresult class_info(void *self, int32_t index, PClassInfo *info) {
    PClassInfo2 more;
    const tresult said = info ? class_info_2(self, index, &more) : kInvalidArgument;
    if (said == kResultOk) memcpy(info, &more, sizeof *info); /* the one begins as the other */
    return said;
}

static tresult class_info_unicode(void *self, int32_t index, PClassInfoW *info) {
    PClassInfo2 more;
    const tresult said = info ? class_info_2(self, index, &more) : kInvalidArgument;
    if (said != kResultOk) return said;
    memset(info, 0, sizeof *info);
    memcpy(info->cid, more.cid, sizeof(TUID));
    info->cardinality = more.cardinality;
    memcpy(info->category, more.category, sizeof info->category);
    vst3_wide(info->name, 64, more.name);
    info->classFlags = more.classFlags;
    memcpy(info->subCategories, more.subCategories, sizeof info->subCategories);
    vst3_wide(info->vendor, 64, more.vendor);
    vst3_wide(info->version, 64, more.version);
    vst3_wide(info->sdkVersion, 64, more.sdkVersion);
    return kResultOk;
}

static tresult create_instance(void *self, const uint8_t *cid, const uint8_t *iid, void **object) {
    const factory *me = self;
    if (!cid || !iid || !object) return kInvalidArgument;
    *object = NULL;
    TUID mine;
    vst3_class_id(jawari_bank_uid(me->bank), mine);
    if (memcmp(cid, mine, sizeof mine)) return kNoInterface;
    char why[JAWARI_WHY] = "there is not enough memory";
    vst3 *made = create(why);
    if (!made) {
        system_say("jawari (%s, VST3): %s", jawari_bank_id(me->bank), why);
        return kOutOfMemory;
    }
    const tresult said = vst3_query(&made->face[COMPONENT], iid, object);
    vst3_release(&made->face[COMPONENT]);
    return said;
}

static tresult host_context(void *self, void *context) {
    (void)self;
    (void)context;
    return kResultOk;
}

static const IPluginFactory3 factory_table = {
    .queryInterface = factory_query,
    .addRef = factory_add,
    .release = factory_release,
    .getFactoryInfo = factory_info,
    .countClasses = classes,
    .getClassInfo = class_info,
    .createInstance = create_instance,
    .getClassInfo2 = class_info_2,
    .getClassInfoUnicode = class_info_unicode,
    .setHostContext = host_context,
};

/* ---- the module ---- */

/* NULL, and the reason on the error output, for a library behind which there is no bank. */
JAWARI_API void *GetPluginFactory(void);
void *GetPluginFactory(void) {
    char why[JAWARI_WHY] = "there is not enough memory";
    factory *me = malloc(sizeof *me);
    jawari_bank *bank = me ? jawari_open_own(why) : NULL;
    if (!bank) {
        system_say("jawari (VST3): %s", why);
        free(me);
        return NULL;
    }
    me->table = &factory_table;
    atomic_init(&me->references, 1);
    me->bank = bank;
    return me;
}
